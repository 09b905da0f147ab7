"""Electronic data sheets: what an object takes, and files that were written carelessly."""

import re

from canopen.objectdictionary import datatypes, ODVariable
import pytest

from facade_manipulator.canopen.eds import misfit, read_dictionary, stated, variables
from facade_manipulator.errors import ParameterError
from facade_manipulator.resources import config_path


def variable(data_type, access='rw'):
    made = ODVariable('made', 0x2000, 1)
    made.data_type, made.access_type = data_type, access
    return made


@pytest.mark.parametrize(('data_type', 'low', 'high'), [
    (datatypes.INTEGER8, -128, 127), (datatypes.UNSIGNED8, 0, 255),
    (datatypes.INTEGER16, -2**15, 2**15 - 1), (datatypes.UNSIGNED16, 0, 2**16 - 1),
    (datatypes.INTEGER32, -2**31, 2**31 - 1), (datatypes.UNSIGNED32, 0, 2**32 - 1)])
def test_an_object_takes_what_its_type_and_its_limits_allow(data_type, low, high):
    made = variable(data_type)
    for inside in (0, 3):
        made.min, made.max = (low + inside, high - inside) if inside else (low - 5, high + 5)
        for value in (low + inside, high - inside):
            assert misfit(made, value) == ''
        for value in (low + inside - 1, high - inside + 1):
            assert misfit(made, value) == (
                f'2000h:01 takes {low + inside} to {high - inside}, not {value}')


def test_an_object_that_cannot_be_written_fits_if_it_has_the_value():
    made = variable(datatypes.UNSIGNED8, 'ro')
    assert 'of unknown value for good, not 7' in misfit(made, 7)
    made.default = 7
    assert misfit(made, 7) == '' and 'is ro, 7 for good, not 8' in misfit(made, 8)
    made.value = 8  # that of a DCF
    assert misfit(made, 8) == '' and misfit(made, 7)
    assert misfit(None, 7) == 'the object is missing' and stated(None) is None


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
def test_a_careless_file_is_read_as_it_was_meant(tmp_path, encoding):
    path = tmp_path / 'careless.eds'
    path.write_text(CARELESS, encoding=encoding)
    dictionary = read_dictionary(path)
    number, text = dictionary[0x2000], dictionary[0x2001]
    assert (number.name, number.min, number.max, stated(number)) == ('Größe', None, 0xFF, 10)
    assert stated(text) == 'CAFE' and 0x2002 not in dictionary


@pytest.mark.parametrize(('text', 'value'), [
    ('7', 7), ('0x1A', 26), ('1A', 26), ('0006', 6), ('017', 15), ('0019', 19), ('0', 0),
    ('-1', -1)])
def test_a_number_is_decimal_hexadecimal_or_as_in_cia_306_octal(tmp_path, text, value):
    path = tmp_path / 'numbers.eds'
    path.write_text(
        '[DeviceInfo]\n[OptionalObjects]\nSupportedObjects=1\n1=0x2000\n[2000]\n'
        f'ParameterName=one\nObjectType=7\nDataType=0004\nAccessType=rw\nDefaultValue={text}\n')
    assert stated(read_dictionary(path)[0x2000]) == value


def contents(path):
    """Return what a file says of each variable."""
    return {
        (one.index, one.subindex): (
            one.data_type, one.access_type, one.min, one.max, stated(one), one.pdo_mappable)
        for one in variables(read_dictionary(path, node_id=3))}


HABITS = {
    'capitals': lambda text: re.sub(r'(?m)^(\[?\w+)(?==|\])', lambda m: m[1].upper(), text),
    'small letters': lambda text: re.sub(r'(?m)^(\[?\w+)(?==|\])', lambda m: m[1].lower(), text),
    'tabs': lambda text: re.sub(r'(?m)^(\w+)=(.*)', '\t\\1\t=\t\\2\t; note', text),
    'zeros': lambda text: re.sub(r'sub(?=\d\])', 'sub0', text),
    'old line ends': lambda text: text.replace('\n', '\r'),
    'sub-objects first': lambda text: '\n\n'.join(reversed(text.split('\n\n'))),
}


@pytest.mark.parametrize('habit', HABITS)
def test_habits_of_makers_leave_the_dictionary_as_it_is(tmp_path, habit):
    original = config_path('drives/epos4.eds')
    text = HABITS[habit](original.read_text('utf-8'))
    assert text != original.read_text('utf-8')
    path = tmp_path / 'drive.eds'
    path.write_text(text)
    assert contents(path) == contents(original)


@pytest.mark.parametrize(('text', 'reason'), [
    ('just words', '.*no section headers.*line: 1'),
    ('[2000]\nObjectType=7\nDataType', '.*line +3.*DataType'),
    ('[2000]\nDataType=seven', "invalid literal .*'seven'"),
    ('[2000]\nDataType=5\n\n[2000]\ndatatype=0x06', '.*line +4.*2000'),
    ('[2000]\nHighLimit=5\nHighLimit=6', '.*line +3.*HighLimit'),
    ('[Tools]\nA=1', 'it has no objects')])
def test_unreadable_data_sheet_is_rejected_with_its_reason(tmp_path, text, reason):
    path = tmp_path / 'words.eds'
    path.write_text(text)
    with pytest.raises(ParameterError, match=(
            f'words.eds is no EDS or DCF that can be read: {reason}')):
        read_dictionary(path)
