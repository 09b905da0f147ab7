import dataclasses
import shutil
import sys

import pytest
import yaml

from facade_manipulator import package_files
from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.eds import read_dictionary, variables
from facade_manipulator.canopen.emcy import fault
from facade_manipulator.drives import profile
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.profile import fitting_profile, load_profile, Quirks
from facade_manipulator.errors import ParameterError
from facade_manipulator.package_files import config_path

NAMES = sorted(path.stem for path in config_path('drives').glob('*.yaml'))
SAFETY = {  # what no drive may lack: it stops for a dead master, a lost axis, and at its limits
    'master_heartbeat',
    'heartbeat_time',
    'quick_stop_deceleration',
    'following_error_window',
    'min_position',
    'max_position',
    'home_position',
    'homing_method',
}
OBJECT = {
    'index': 0x6085,
    'subindex': 0,
    'value': 'quick_stop_deceleration',
    'required': True,
}


def entry(name, **changes):
    """Return the entries of a profile of the package with changes."""
    return yaml.safe_load(config_path(f'drives/{name}.yaml').read_text()) | changes


def with_pdos(**changes):
    return entry('generic_cia402', pdos=entry('generic_cia402')['pdos'] | changes)


def write(folder, data):
    """Write a drive profile; return its path."""
    for name in ('cia402.eds', 'epos4.eds'):
        (folder / name).touch()
    (folder / 'mine.yaml').write_text(yaml.safe_dump(data))
    return str(folder / 'mine.yaml')


@pytest.mark.parametrize('name', NAMES)
def test_every_profile_requires_the_safety_objects(name):
    profile = load_profile(name)
    assert {item.value for item in profile.objects if item.required} >= SAFETY
    assert (profile.lost_master_reaction, 0, 3, True) in profile.objects
    places = [(item.index, item.subindex) for item in profile.objects]
    assert len(set(places)) == len(places)


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize(
    ('index', 'option'),
    [
        (0x605A, 6),  # CiA 402-2: slow down on the quick stop ramp, stay in quick stop
        (0x605E, 2),  # CiA 402-2: slow down on the quick stop ramp
    ],
)
def test_every_profile_brakes_on_the_quick_stop_ramp(name, index, option):
    objects = load_profile(name).objects
    assert [one.value for one in objects if one.index == index] == [option]


@pytest.mark.parametrize(
    ('key', 'limits'),
    [
        *(
            (key, (1, 50_000))
            for key in ((0x607F, 0), (0x6080, 0), (0x6099, 1), (0x6099, 2))
        ),
        ((0x30B2, 0), (0, 15_000)),
        ((0x6066, 0), (0, 0)),
        ((0x60C2, 1), (0, 100)),
    ],
)
def test_epos4_limits_match_the_manufacturer_data(key, limits):
    objects = variables(read_dictionary(config_path('drives/epos4.eds')))
    assert (objects[key].min, objects[key].max) == limits


@pytest.mark.parametrize('field', ['vendor_id', 'product_code'])
@pytest.mark.parametrize(
    ('of_type', 'own', 'found'),
    [(0xFB, 0, 0xFB), (0xFB, 7, 7), (None, 0, 0), (None, 7, 7)],
)
def test_maker_and_product_default_to_the_profile(field, of_type, own, found):
    profile = dataclasses.replace(load_profile('generic_cia402'), **{field: of_type})
    axis = dataclasses.replace(DEFAULT_AXES[0], **{field: own})
    assert getattr(profile.applied(axis), field) == found


@pytest.mark.parametrize('name', ['nothing', 'epos4'])
def test_missing_profile_or_data_folder_is_rejected(tmp_path, monkeypatch, name):
    if name in NAMES:
        monkeypatch.setattr(package_files, 'PACKAGE', tmp_path / 'facade_manipulator')
        monkeypatch.setattr(sys, 'prefix', str(tmp_path))
        monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    with pytest.raises(
        ParameterError, match=f'there is no drive profile {name}: .*searched'
    ):
        load_profile(name)


@pytest.mark.parametrize(
    'data, words',
    [
        (entry('epos4', velocity_unit='knots'), 'velocity_unit.*knots'),
        (entry('epos4', acceleration_unit='g'), 'acceleration_unit.*g'),
        (entry('epos4', eds='nowhere.eds'), 'nowhere.eds does not exist'),
        (entry('epos4', quirks={'never_follows': 1}), 'never_follows'),
        (entry('epos4', quirks={'is_blue': True}), 'unknown entry is_blue'),
        (entry('epos4', objects=None), 'valid'),
        (entry('epos4', errors=None), 'valid'),
        *(
            (entry('epos4', objects=[OBJECT | {name: value}]), str(value))
            for name, value in (
                ('value', 'speed_of_light'),
                ('value', 1.5),
                ('value', -(2**31) - 1),
                ('value', 2**32),
                ('index', 0xFFF),
                ('index', 0x10000),
                ('subindex', -1),
                ('subindex', 255),
            )
        ),
        (entry('epos4', objects=[{'index': 0x6085}]), 'missing'),
        ({'eds': 'cia402.eds'}, 'missing'),
        (entry('epos4', of_place=[[0xFFF, 0]]), '4095'),
        (entry('epos4', input_polarity={'index': 0x10000, 'subindex': 0}), '65536'),
        *(
            (entry('epos4', errors={code: meaning}), words)
            for code, meaning, words in (
                (0xFF02, {'message': '', 'is_warning': 1}, 'is_warning'),
                (0xFF02, {'words': ''}, 'unknown entry words'),
                (0xFF02, {}, 'message'),
            )
        ),
        *(
            (entry('epos4', errors={code: {'message': ''}}), words)
            for code, words in (
                (7580, "error code 7580 .*; next: .* '7580' or '1D9C'"),
                ('8a80', "error code '8a80'"),
                ('A80', "error code 'A80'"),
                ('8x80', "error code '8x80'"),
                (0x10000, 'error code 65536'),
                (True, 'error code True'),
            )
        ),
        *(
            (entry('epos4', **{name: value}), f'{name} = {value!r}')
            for name, value in (
                ('vendor_id', '0xFB'),
                ('vendor_id', -1),
                ('product_code', 2**32),
            )
        ),
        *(
            (
                entry('epos4', homing_methods=[37, method]),
                f'homing_methods = {method!r}',
            )
            for method in ('17', 128, 1.0)
        ),
        (
            entry(
                'epos4', input_polarity={'index': 0x3141, 'subindex': 2, 'shift': 32}
            ),
            'shift = 32',
        ),
        (with_pdos(TPDO1=[0x6041, 0x6061]), 'no TPDO maps object 6064h'),
        (with_pdos(RPDO1=[0x6040, 0x607A]), 'no RPDO maps object 6060h'),
        (
            with_pdos(RPDO1=[0x6040, 0x6060, 0x607A, 0x6064]),
            'RPDO maps 6064h',
        ),
        (with_pdos(TPDO2=[0x2000]), 'TPDO maps 2000h, '),
        (
            with_pdos(TPDO4=[0x606C, 0x60F4, 0x6077]),
            'TPDO4 has 10 bytes, above the limit of 8',
        ),
        (with_pdos(TPDO5=[]), 'unknown entry TPDO5'),
        (['a list'], 'not a table'),
    ],
)
def test_invalid_profile_is_rejected_with_file_and_reason(tmp_path, data, words):
    with pytest.raises(ParameterError, match=f'mine.yaml.*{words}'):
        load_profile(write(tmp_path, data))


@pytest.mark.parametrize('code', ['8A80', '8A8x', 0x8A80])
def test_error_code_of_a_profile_has_its_meaning(tmp_path, code):
    meaning = {'message': 'the encoder has failed', 'loses_position': True}
    profile = load_profile(write(tmp_path, entry('epos4', errors={code: meaning})))
    found = fault(0x8A80, profile.errors)
    assert found.loses_position
    assert found.message == 'the encoder has failed (error code 8A80h)'


@pytest.mark.parametrize('name', Quirks._fields)
def test_quirk_of_a_wrong_type_is_rejected(tmp_path, name):
    with pytest.raises(
        ParameterError, match=f"{name} = 'false' is not (one of|from 0)"
    ):
        load_profile(write(tmp_path, entry('epos4', quirks={name: 'false'})))


def test_generic_profile_shows_every_quirk_with_its_default():
    assert entry('generic_cia402')['quirks'] == Quirks()._asdict(), (
        'next: write the quirk into config/drives/generic_cia402.yaml'
    )


@pytest.mark.parametrize(
    ('vendor', 'product', 'name'),
    [
        (0xFB, 1, 'epos4'),
        (0xFB, 7, 'mine'),
        (0, 7, 'simulated'),
        (12345, 7, 'generic_cia402'),
        (None, None, 'generic_cia402'),
    ],
)
def test_profile_is_found_by_maker_and_product(
    tmp_path, monkeypatch, vendor, product, name
):
    shutil.copytree(config_path('drives'), tmp_path / 'drives')
    write(tmp_path / 'drives', entry('epos4', product_code=7))
    monkeypatch.setattr(profile, 'config_path', lambda name: tmp_path / name)
    assert fitting_profile(vendor, product) == name


# --- process data


def test_profile_without_process_data_has_the_default_map(tmp_path):
    data = entry('simulated')
    del data['motor_speed_unit']
    profile = load_profile(write(tmp_path, data))
    assert profile.pdos == pdo.PDO_MAP == load_profile('generic_cia402').pdos
    assert (
        profile.motor_speed_unit == profile.acceleration_unit == profile.velocity_unit
    )
