from copy import deepcopy
import dataclasses
from functools import cache
import shutil

from canopen import import_od
from canopen.objectdictionary import datatypes
import pytest
import yaml

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.eds import read_dictionary
from facade_manipulator.drives import profile
from facade_manipulator.drives.axis_settings import AXIS_NAMES, DEFAULT_AXES
from facade_manipulator.drives.configuration import drive_writes
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.profile import fitting_profile, load_profile, Quirks
from facade_manipulator.errors import ParameterError
from facade_manipulator.resources import config_path

NAMES = sorted(path.stem for path in config_path('drives').glob('*.yaml'))
SAFETY = {  # what no drive may lack: it stops for a dead master, a lost axis, and at its limits
    'master_heartbeat', 'heartbeat_time', 'quick_stop_deceleration', 'following_error_window',
    'min_position', 'max_position', 'home_position', 'homing_method'}
OBJECT = {'index': 0x6085, 'subindex': 0, 'value': 'quick_stop_deceleration', 'required': True}


@cache
def shipped(name):
    return yaml.safe_load(config_path(f'drives/{name}.yaml').read_text())


def entry(name, **changes):
    return deepcopy(shipped(name)) | changes


def with_pdos(**changes):
    return entry('generic_cia402', pdos=entry('generic_cia402')['pdos'] | changes)


def write(directory, data):
    for name in ('cia402.eds', 'epos4.eds'):
        (directory / name).write_text('')
    text = data if isinstance(data, str) else yaml.safe_dump(data)
    (directory / 'mine.yaml').write_text(text)


@pytest.mark.parametrize('name', NAMES)
def test_every_profile_requires_the_safety_objects(name):
    profile = load_profile(name)
    assert {item.value for item in profile.objects if item.required} >= SAFETY
    assert all(profile.location(quantity) for quantity in SAFETY)
    assert (profile.lost_master_reaction, 0, 3, True) in profile.objects
    assert profile.stops_without_master


@pytest.mark.parametrize('name', NAMES)
def test_no_profile_writes_an_object_twice(name):
    places = [(item.index, item.subindex) for item in load_profile(name).objects]
    assert len(set(places)) == len(places)


@pytest.mark.parametrize('name', NAMES)
def test_eds_has_every_mapped_object(name):
    dictionary = import_od(str(load_profile(name).eds), 1)
    for mapped in pdo.KNOWN_OBJECTS.values():
        found = dictionary.get_variable(mapped.index, mapped.subindex)
        assert found.pdo_mappable and len(found) == mapped.mapping & 0xFF


@pytest.mark.parametrize('field', ['vendor_id', 'product_code'])
@pytest.mark.parametrize(('of_type', 'own', 'found'), [
    (0xFB, 0, 0xFB), (0xFB, 7, 7), (None, 0, 0), (None, 7, 7)])
def test_maker_and_product_default_to_the_profile(field, of_type, own, found):
    profile = dataclasses.replace(load_profile('generic_cia402'), **{field: of_type})
    axis = dataclasses.replace(DEFAULT_AXES[0], **{field: own})
    assert getattr(profile.applied(axis), field) == found


def test_own_profile_is_read_from_its_directory(tmp_path):
    former = dict.fromkeys(('pdo_only_on_sync', 'zero_statusword_until_controlword'), True)
    write(tmp_path, entry('epos4', quirks={'boots_operational': True, **former},
                          input_polarity={'index': 0x2310, 'subindex': 1, 'shift': 8}))
    profile = load_profile('mine', tmp_path)
    assert profile.input_polarity == (0x2310, 1, 8)
    assert profile.quirks == Quirks(boots_operational=True)
    assert profile.velocity_unit == 'rpm' and profile.eds == tmp_path / 'epos4.eds'


@pytest.mark.parametrize('data, words', [
    (entry('epos4', velocity_unit='knots'), 'velocity_unit = knots'),
    (entry('epos4', eds='nowhere.eds'), 'nowhere.eds does not exist'),
    (entry('epos4', homing_methods=[37, 'x']), "homing method = 'x'"),
    (entry('epos4', quirks={'boots_operational': 1}), 'neither true nor false'),
    (entry('epos4', quirks={'is_blue': True}), 'unknown entry is_blue'),
    (entry('epos4', quirks={'csp_bits': 0x0F}), 'csp_bits = 0xF has other bits than 4 to 6'),
    (entry('epos4', quirks={'csp_bits': 0x80}), 'csp_bits = 128 is not a whole number'),
    (entry('epos4', colour='blue'), 'unknown entry colour'),
    (entry('epos4', objects=[{**OBJECT, 'value': 'speed_of_light'}]), 'speed_of_light'),
    (entry('epos4', objects=[{**OBJECT, 'index': 0x10000}]), 'index = 65536'),
    (entry('epos4', objects=[{**OBJECT, 'subindex': -1}]), 'subindex = -1'),
    (entry('epos4', objects=[{**OBJECT, 'value': 1.5}]), '6085'),
    *((entry('epos4', objects=[{**OBJECT, name: value}]), str(value)) for name, value in (
        ('index', 0xFFF), ('subindex', 255), ('value', -2**31 - 1), ('value', 2**32))),
    *((entry('epos4', **{name: value}), word) for name, value, word in (
        ('homing_methods', [-129], '-129'), ('homing_methods', [128], '128'),
        ('vendor_id', 2**32, 'vendor_id'), ('counts_per_revolution', -1, 'counts_per_rev'),
        ('errors', {0xFF: {'message': ''}}, 'an error code = 255'),
        ('errors', {0xFF02: {'message': '', 'is_warning': 1}}, 'neither true nor false'),
        ('errors', {0xFF02: {'words': ''}}, 'error FF02 has the unknown entry words'),
        ('errors', {0xFF02: {}}, 'message'), ('acceleration_unit', 'g', 'acceleration_unit = g'),
        ('of_place', [[0xFFF, 0]], 'index = 4095'), ('of_place', [[0x2000, 255]], 'subindex'),
        ('input_polarity', {'index': 0x10000, 'subindex': 0}, 'input_polarity = 65536'))),
    (entry('epos4', objects=[{'index': 0x6085}]), 'value is missing'),
    (entry('epos4', objects=None), 'not valid'),
    ({'eds': 'cia402.eds'}, 'is missing'),
    (with_pdos(TPDO1=[0x6041, 0x6061]), 'no TPDO carries object 6064'),
    (with_pdos(RPDO1=[0x6040, 0x607A]), 'no RPDO carries object 6060'),
    (with_pdos(RPDO1=[0x6040, 0x6060, 0x607A, 0x6064]),
     'RPDO1 carries 24676, which is not one of 0x6040'),
    (with_pdos(TPDO2=[0x2000]), 'state index, subindex and bits'),
    (with_pdos(TPDO2=[{'index': 0x2000, 'subindex': 0, 'bits': 7}]), 'not 8, 16 or 32'),
    *((with_pdos(TPDO2=[{'index': 0x2000, 'subindex': 0, 'bits': 8} | change]), words)
      for change, words in (({'index': 0xFFF}, 'index = 4095'), ({'index': 1 << 16}, 'index = 65'),
                            ({'subindex': -1}, 'subindex = -1'), ({'subindex': 255}, '= 255'))),
    (with_pdos(TPDO5=[]), 'pdos has the unknown entry TPDO5'),
    (with_pdos(TPDO1=[0x6041, 0x6061, 0x6064, 0x6077]), 'TPDO1 has 9 bytes, bound 8'),
    ('- a list', 'not a table'),
    ('a: [', 'cannot be read'),
])
def test_invalid_profile_is_rejected_with_file_and_reason(
        tmp_path, data, words):
    write(tmp_path, data)
    with pytest.raises(ParameterError, match='mine.yaml') as caught:
        load_profile('mine', tmp_path)
    assert words in str(caught.value)
    with pytest.raises(ParameterError, match='there is no drive profile nothing'):
        load_profile('nothing', tmp_path)


def test_profile_may_lie_outside_the_package(tmp_path):
    for name in ('generic_cia402.yaml', 'cia402.eds'):
        (tmp_path / name).write_text((config_path('drives') / name).read_text())
    path = (tmp_path / 'generic_cia402.yaml').rename(tmp_path / 'mine.yaml')
    assert load_profile(str(path)).eds == tmp_path / 'cia402.eds'


@pytest.mark.parametrize(('vendor', 'product', 'name'), [
    (0xFB, 1, 'epos4'), (0xFB, 7, 'mine'), (0, 7, 'simulated'), (12345, 7, 'generic_cia402'),
    (None, None, 'generic_cia402')])
def test_maker_and_product_find_the_profile(tmp_path, monkeypatch, vendor, product, name):
    shutil.copytree(config_path('drives'), tmp_path / 'drives')
    text = (tmp_path / 'drives/epos4.yaml').read_text()
    (tmp_path / 'drives/mine.yaml').write_text(f'{text}\nproduct_code: 7\n')
    monkeypatch.setattr(profile, 'config_path', lambda _: tmp_path / 'drives')
    assert fitting_profile(vendor, product) == name


# --- process data

def test_profile_without_process_data_has_the_default_map(tmp_path):
    assert load_profile('generic_cia402').pdos == pdo.PDO_MAP
    data = entry('simulated')
    del data['motor_speed_unit']
    write(tmp_path, data)
    profile = load_profile('mine', tmp_path)
    assert profile.pdos == pdo.PDO_MAP
    assert profile.motor_speed_unit == profile.acceleration_unit == profile.velocity_unit


def test_unused_object_keeps_its_place_in_a_mapping(tmp_path):
    write(tmp_path, entry('simulated', pdos={
        'RPDO3': [0x6040, 0x6060, 0x607A],
        'TPDO4': [{'index': 0x1000, 'subindex': 0, 'bits': 16},
                  {'index': 0xFFFF, 'subindex': 254, 'bits': 32}],
        'TPDO1': [{'index': 0x2000, 'subindex': 3, 'bits': 8}, 0x6041, 0x6061, 0x6064]}))
    pdos = {one.name: one for one in load_profile('mine', tmp_path).pdos}
    assert [one.mapping for one in pdos['TPDO4'].content] == [0x10000010, 0xFFFFFE20]
    rpdo, tpdo = pdos['RPDO3'], pdos['TPDO1']
    assert (rpdo.number, rpdo.is_transmitted, rpdo.communication_index) == (3, False, 0x1402)
    assert tpdo.content[0].mapping == 0x20000308
    assert tpdo.codec.unpack(bytes([9, 0x37, 2, 8, 1, 0, 0, 0])) == (9, 0x237, 8, 1)


# --- the maker's limits

def misfit(variable, value):
    """Return why an object of an EDS does not take a value, '' if it does."""
    label = f'{variable.index:04X}h:{variable.subindex:02X}'
    if not variable.writable:
        return '' if variable.default == value else f'{label} is {variable.access_type}'
    bits, signed = len(variable), variable.data_type in datatypes.SIGNED_TYPES
    low, high = (-1 << bits - 1, (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
    low = low if variable.min is None else max(low, variable.min)
    high = high if variable.max is None else min(high, variable.max)
    return '' if low <= value <= high else f'{label} takes {low} to {high}, not {value}'


@pytest.mark.parametrize('rate', [100, 500])
@pytest.mark.parametrize('axis', DEFAULT_AXES, ids=AXIS_NAMES)
@pytest.mark.parametrize('name', NAMES)
def test_every_written_value_fits_its_eds(name, axis, rate):
    profile = load_profile(name)
    dictionary = read_dictionary(profile.eds, axis.node_id)
    for write in drive_writes(profile, profile.applied(axis), ControllerSettings(rate=rate)):
        variable = dictionary.get_variable(write.index, write.subindex)
        assert misfit(variable, write.value) == ''
        assert write.size in (None, len(variable) // 8)


def test_value_outside_epos4_bounds_is_named():
    """The facts that our profile was once wrong about, and their like."""
    epos4 = read_dictionary(load_profile('epos4').eds)
    for index, subindex, value, words in (
            (0x6066, 0, 10, '6066h:00 takes 0 to 0, not 10'),
            (0x6085, 0, 0, '6085h:00 takes 1 to 4294967295, not 0'),
            (0x60C2, 1, 101, '60C2h:01 takes 0 to 100, not 101'),
            (0x30B2, 0, 15001, '30B2h:00 takes 0 to 15000'),
            (0x3141, 2, 1 << 16, '3141h:02 takes 0 to 65535'),
            (0x60AA, 0, 0, '60AAh:00 takes 12583680 to 12583680'),
            (0x6064, 0, 7, '6064h:00 is ro')):
        assert words in misfit(epos4.get_variable(index, subindex), value)
    for index in (0x1F80, 0x1019, 0x607C, 0x607E, 0x608F, 0x6091):
        assert index not in epos4


@pytest.mark.parametrize(('objects', 'reaction', 'stops'), [
    ([(0x1016, 'master_heartbeat', True), (0x6007, 3, True)], 0x6007, True),
    ([(0x1016, 'master_heartbeat', False), (0x6007, 3, True)], 0x6007, False),
    ([(0x1016, 'master_heartbeat', True), (0x6007, 0, True)], 0x6007, False),
    ([(0x1016, 'master_heartbeat', True), (0x2107, 1, True)], 0x2107, True),
    ([(0x1016, 'master_heartbeat', True), (0x2107, 1, True)], 0x6007, False)])
def test_profile_knows_whether_dead_master_stops_drive(
        tmp_path, objects, reaction, stops):
    write(tmp_path, entry('simulated', lost_master_reaction=reaction, objects=[
        {'index': index, 'subindex': 0, 'value': value, 'required': required}
        for index, value, required in objects]))
    assert load_profile('mine', tmp_path).stops_without_master is stops
