"""Electronic data sheets with the deviations of makers from CiA 306."""

import re

import pytest

from facade_manipulator.canopen.eds import read_dictionary, variables
from facade_manipulator.errors import ParameterError
from facade_manipulator.package_files import config_path

CARELESS = """\
[Comments]
Lines=FE
[DeviceInfo]
VendorNumber=
[OptionalObjects]
SupportedObjects=3
1=0x2000
2=0x2001
3=0x2002
[2000]
ParameterName=Größe
ObjectType=7
DataType = 0x0007 ; a number
AccessType=rw
LowLimit=
HighLimit=FF
DefaultValue=0A
[2001]
ParameterName=text
ObjectType=0x7
DataType=0011
AccessType=ro
DefaultValue=CAFE
[2002]
ParameterName=of no type, as in Kinco's FD124S (ros2_canopen, issue 202)
ObjectType=0x7
"""


@pytest.mark.parametrize('encoding', ['utf-8', 'utf-8-sig', 'cp1252'])
def test_incorrect_data_sheet_is_read_as_intended(tmp_path, encoding):
    path = tmp_path / 'careless.eds'
    path.write_text(CARELESS, encoding=encoding)
    dictionary = read_dictionary(path)
    number = dictionary[0x2000]
    text = dictionary[0x2001]
    assert number.name == 'Größe'
    assert number.min is None
    assert number.max == 0xFF
    assert number.default == 10
    assert text.default == 'CAFE'
    assert 0x2002 not in dictionary


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('7', 7),
        ('0x1A', 26),
        ('1A', 26),
        ('0006', 6),
        ('017', 15),
        ('0019', 19),
        ('0', 0),
        ('-1', -1),
    ],
)
def test_number_is_decimal_hexadecimal_or_octal(tmp_path, text, value):
    path = tmp_path / 'numbers.eds'
    path.write_text(CARELESS.replace('=0A', f'={text}'), 'utf-8')
    assert read_dictionary(path)[0x2000].default == value


def contents(path):
    """Return the entries of each variable in a file."""
    found = {}
    for key, one in variables(read_dictionary(path, node_id=3)).items():
        limits = (one.min, one.max)
        found[key] = (
            one.data_type,
            one.access_type,
            limits,
            one.default,
            one.pdo_mappable,
        )
    return found


NAMES = r'(?m)^(\[?\w+)(?==|\])'  # of sections and entries


def with_capitals(text):
    return re.sub(NAMES, lambda name: name[1].upper(), text)


def with_small_letters(text):
    return re.sub(NAMES, lambda name: name[1].lower(), text)


def with_tabs_and_notes(text):
    return re.sub(r'(?m)^(\w+)=(.*)', '\t\\1\t=\t\\2\t; note', text)


def with_zeros_in_subindices(text):
    return re.sub(r'sub(?=\d\])', 'sub0', text)


def with_old_line_ends(text):
    return text.replace('\n', '\r')


def with_sub_objects_first(text):
    sections = text.split('\n\n')
    return '\n\n'.join(reversed(sections))


HABITS = {
    'capitals': with_capitals,
    'small letters': with_small_letters,
    'tabs': with_tabs_and_notes,
    'zeros': with_zeros_in_subindices,
    'old line ends': with_old_line_ends,
    'sub-objects first': with_sub_objects_first,
}


@pytest.mark.parametrize('habit', HABITS)
def test_makers_deviations_leave_the_dictionary_unchanged(tmp_path, habit):
    original = config_path('drives/epos4.eds')
    text = HABITS[habit](original.read_text('utf-8'))
    assert text != original.read_text('utf-8')
    path = tmp_path / 'drive.eds'
    path.write_text(text)
    assert contents(path) == contents(original)


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('just words', '.*no section headers.*line: 1'),
        ('[2000]\nObjectType=7\nDataType', '.*line +3.*DataType'),
        ('[2000]\nDataType=seven', "invalid literal .*'seven'"),
        ('[2000]\nDataType=5\n\n[2000]\ndatatype=0x06', '.*line +4.*2000'),
        ('[2000]\nHighLimit=5\nHighLimit=6', '.*line +3.*HighLimit'),
        ('[Tools]\nA=1', 'it contains no objects'),
    ],
)
def test_unreadable_data_sheet_is_rejected_with_its_reason(tmp_path, text, reason):
    path = tmp_path / 'words.eds'
    path.write_text(text)
    with pytest.raises(
        ParameterError, match=(f'words.eds is not a readable EDS or DCF: {reason}')
    ):
        read_dictionary(path)
