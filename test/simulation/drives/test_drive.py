from dataclasses import replace
import math

from frames import encode_rpdo1
from hypothesis import given
from hypothesis import strategies as st
import pytest
from simulation.drives.bench import Bench, NMT_RESET, NMT_RESET_COMMUNICATION

from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.states import State

# --- network management and heartbeats


def test_drive_boots_into_pre_operational_with_one_message():
    bench = Bench()
    assert bench.wait(0.06) == [(0x702, b'\x00')]
    assert bench.wait(10.0) == []
    assert bench.write(0x1017, 0, 50) is None
    assert bench.wait(0.051) == [(0x702, b'\x7f')]


@pytest.mark.parametrize(
    'command, reaction', [(NMT_RESET, 1), (NMT_RESET_COMMUNICATION, 3)]
)
def test_reset_boots_and_communication_reset_keeps_application(command, reaction):
    bench = Bench().configure()
    assert bench.nmt(command) == []
    assert bench.wait(0.2) == [(0x702, b'\x00')]
    assert bench.read(0x1017) == 0
    assert bench.read(0x6007) == reaction


@pytest.mark.parametrize(
    'named, options, state',
    [
        (0x6007, {'_6007': 0}, State.OPERATION_ENABLED),
        (0x6007, {'_6007': 1}, State.FAULT),
        (0x6007, {'_6007': 2}, State.SWITCH_ON_DISABLED),
        (0x6007, {'_6007': 3}, State.QUICK_STOP_ACTIVE),
        (0x605E, {'_6007': 3, '_605E': 2}, State.SWITCH_ON_DISABLED),
    ],
)
def test_drive_reacts_to_dead_master_after_150_ms(named, options, state):
    profile = replace(load_profile('simulated'), lost_master_reaction=named)
    bench = Bench(profile).configure(**options)
    bench.sends_heartbeat = True
    bench.enable()
    bench.send(0x77F, [5])
    bench.wait(0.1499)
    assert bench.drive.axis.state is State.OPERATION_ENABLED
    assert not bench.emergencies()
    bench.wait(0.0002)
    assert bench.drive.axis.state is state
    assert [message.code for message in bench.emergencies()] == [0x8130]


# --- objects


def test_sdo_transfers_have_the_bytes_of_cia_301():
    bench = Bench().boot()
    for request, answer in (
        ('4000100000000000', '4300100092010200'),  # device type
        ('2b17100032000000', '6017100000000000'),  # heartbeat 50 ms
        ('4017100000000000', '4b17100032000000'),
        ('2300100000000000', '8000100002000106'),  # read only
        ('4001200000000000', '8001200000000206'),  # no such object
        ('4018100900000000', '8018100911000906'),  # no such subindex
        ('2317100000000000', '8017100010000706'),  # too long
        ('2f17100000000000', '8017100010000706'),  # too short
        ('c217100020000000', '8017100001000405'),  # block download: not offered
    ):
        assert bench.sdo(bytes.fromhex(request)) == bytes.fromhex(answer)


# not mappable
@pytest.mark.parametrize(
    'index, subindex, value, code',
    [
        (0x605A, 0, 9, 0x06090031),
        (0x605A, 0, 1, 0x06090030),
        (0x6007, 0, -1, 0x06090032),
        (0x6098, 0, 5, 0x06090030),
        (0x6060, 0, 3, 0x06090030),
        (0x1600, 1, 0x60400010, 0x08000022),
        (0x1600, 0, 0, 0x08000022),
        (0x1010, 1, 1, 0x08000020),
        (0x1A01, 1, 0x60650020, 0x06040041),
        (0x1A01, 1, 0x12340020, 0x06040041),
        (0x1A01, 1, 0x60640010, 0x06040041),
    ],
)
def test_wrong_value_is_rejected_with_abort_code(index, subindex, value, code):
    bench = Bench().boot()
    bench.write(0x1801, 1, 0xC0000282)  # TPDO2 is disabled and has no count
    bench.write(0x1A01, 0, 0)
    before = bench.read(index, subindex)
    assert bench.write(index, subindex, value) == code
    assert bench.read(index, subindex) == before


def test_another_drive_has_no_values_stored_in_the_first():
    bench = Bench().boot()
    default = bench.read(0x1017)
    bench.write(0x1017, 0, 77)
    assert bench.write(0x1010, 1, 0x65766173) is None
    bench.drive.reboot()
    assert bench.boot().read(0x1017) == 77
    bench.drive.set_identity(1, 2, 3, 5)
    assert bench.boot().read(0x1017) == default
    assert bench.read(0x1018, 4) == 5


# --- process data


def test_tpdo_is_sent_after_sync_as_its_type_requires():
    bench = Bench().configure()
    answers = [bench.sync() for _ in range(30)]
    for answer in answers:
        assert len(answer[0x182]) == 7
        assert len(answer[0x282]) == 8
    assert [k for k, a in enumerate(answers) if 0x382 in a] == [9, 19, 29]


def test_short_rpdo_is_reported_once_and_stops():
    bench = Bench().configure().enable()
    bench.send(0x202, encode_rpdo1(0x0F, 8, 1234)[:6])
    bench.send(0x202, b'')
    assert [message.code for message in bench.emergencies()] == [0x8210]
    assert bench.drive.axis.state is State.QUICK_STOP_ACTIVE
    assert bench.read(0x607A) != 1234


# --- whatever else is on the bus

cob_ids = st.sampled_from([0x000, 0x080, 0x202, 0x302, 0x602, 0x77F])
contents = st.binary(max_size=8) | st.binary(min_size=8, max_size=8)
frame = st.tuples(cob_ids | st.integers(0, 0x7FF), contents, st.floats(0.0, 0.02))
FRAMES = st.lists(frame, min_size=1, max_size=60)


@given(FRAMES, st.booleans())
def test_drive_survives_random_frames_on_its_bus(frames, enabled):
    bench = Bench().configure()
    if enabled:
        bench.enable()
    for cob_id, data, pause in frames:
        bench.now += pause
        bench.send(cob_id, data)
        bench.sent += bench.drive.advance(bench.now)
        assert abs(bench.drive.motor.carriage_position) <= 0.56
        assert math.isfinite(bench.drive.motor.velocity)
    assert all(0 <= cob_id <= 0x7FF and len(data) <= 8 for cob_id, data in bench.sent)
    assert all(len(data) == 8 for cob_id, data in bench.sent if cob_id == 0x82)
    bench.nmt(NMT_RESET)
    bench.wait(0.2)
    bench.configure().enable()  # and the drive works afterwards
