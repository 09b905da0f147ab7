from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.canopen import emcy
from facade_manipulator.canopen.emcy import error_code, Fault, fault, is_error_reset
from facade_manipulator.errors import ParameterError

CODES = st.integers(0x100, 0xFFFF)  # of faults


@pytest.mark.parametrize(
    'code, words',
    [
        (0x8611, 'following error'),
        (0x8A81, 'positive limit switch'),
        (0x8A82, 'software position limit'),
        (0x8A83, 'at a limit'),
        (0x8110, 'lost CAN frames'),
        (0x81AB, 'communication'),
        (0x8210, 'wrong length'),
        (0x738C, 'position is lost'),
        (0x7392, 'against the motor'),
        (0x4380, 'too hot'),
        (0x3210, 'too high'),
        (0x3220, 'too low'),
        (0x6100, 'drive software'),
        (0xE000, 'no table'),
    ],
)
def test_error_code_is_described_by_its_narrowest_row(code, words):
    assert words in fault(code, {}).message


@pytest.mark.parametrize(
    'code',
    [
        0x7380,
        0x738F,
        0x7392,  # maxon EPOS4
        0x7320,  # maxon EPOS: the detected position is no longer valid
        0x7300,  # Faulhaber MC 5010: encoder; Elmo: resolver or encoder feedback failed
        0x7303,
        0x7304,
        0x7305,
        0x7306,
        0x7307,  # CiA 402: resolvers and incremental sensors
        0x6010,  # CiA 402: reset by the watchdog
    ],
)
def test_code_of_lost_position_requires_homing(code):
    assert fault(code, {}).loses_position


@given(CODES.filter(lambda code: code != 0x6010 and code & 0xFF00 != 0x7300))
def test_other_codes_keep_the_home_position(code):
    assert not fault(code, {}).loses_position


def test_code_in_profile_precedes_the_table():
    """FF02h is a watchdog for maxon and a wrong bit for Technosoft (iPOS, emergency codes)."""
    own = {'FF02': Fault('the watchdog has come')}
    assert 'watchdog' in fault(0xFF02, own).message
    assert 'watchdog' not in fault(0xFF02, {}).message
    assert fault(0x7305, own).loses_position


def test_wide_row_of_a_profile_precedes_the_table():
    own = {'8Axx': Fault('the ramp has failed'), '8A80': Fault('the switch has failed')}
    assert 'ramp' in fault(0x8A81, own).message
    assert 'switch' in fault(0x8A80, own).message


def test_code_without_quotes_in_the_table_is_rejected(tmp_path, monkeypatch):
    (tmp_path / 'error_codes.yaml').write_text('8120: {message: error passive}')
    monkeypatch.setattr(emcy, 'config_path', lambda name: tmp_path / name)
    with pytest.raises(ParameterError, match=r"error_codes.yaml.* 8120 .*next.*'8120'"):
        emcy.read_faults.__wrapped__()


def test_error_code_is_in_the_first_two_bytes():
    assert error_code(bytes.fromhex('1186250102030405')) == 0x8611


@pytest.mark.parametrize(
    ('code', 'is_reset'), [(0x0000, True), (0x00FF, True), (0x0100, False)]
)
def test_codes_00xx_report_the_end_of_an_error(code, is_reset):
    """CiA 301: codes 00xxh are error reset or no error."""
    assert is_error_reset(code) is is_reset
