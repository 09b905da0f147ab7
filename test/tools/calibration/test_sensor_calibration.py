"""Raw sensors found from recordings of a gondola of the tests' own."""

from dataclasses import replace
from functools import cache
import math

import estimator_plant as plant
import numpy as np
import pytest
import yaml

from facade_manipulator.errors import CalibrationError, ParameterError
from facade_manipulator.tools.calibration import __main__
from facade_manipulator.tools.calibration.sensor_fit import fit_sensors, SensorRecording

NAMED = {'left': plant.LASERS['left'], 'right': plant.LASERS['right'], 'fix': plant.BETTER}
SETUP = plant.setup_of(NAMED, plant.Imu())
PUSHES = (6.0, 17.0, 28.0, 39.0, 50.0)
WRONG = {'left': replace(plant.LASERS['left'], stamp_error=-5e-3),
         'right': replace(plant.LASERS['right'], place=(0.515, 0.0, 0.0), stamp_error=4e-3),
         'fix': replace(plant.BETTER, stamp_error=0.02)}
SCALE, YAW = 1.02, 0.02


@cache
def measured(duration=62.0, strength=1.0, pushes=PUSHES, seed=3):
    motion = plant.move(plant.Day(duration, seed, strength, pushes=pushes))
    _, stamps, rates, forces = plant.inertial(motion, plant.Imu(), seed)
    wall = plant.Wall(seed)
    return SensorRecording(np.column_stack([stamps, rates, forces]), {
        name: np.column_stack(plant.ranges(motion, wall, name, one, seed)[1:])
        for name, one in WRONG.items()})


def recording(**changes):
    """Return what wrong sensors measured: the fix by a factor, the inertial one turned."""
    imu, walls = measured(**changes)
    imu, walls = imu.copy(), {name: table.copy() for name, table in walls.items()}
    walls['fix'][:, 1] *= SCALE
    cosine, sine = math.cos(YAW), math.sin(YAW)
    for x in (1, 4):
        imu[:, [x, x + 1]] = imu[:, [x, x + 1]] @ [[cosine, -sine], [sine, cosine]]
    return SensorRecording(imu, walls)


@pytest.mark.long
def test_wrong_sensors_are_found_within_their_deviations():
    found = fit_sensors(SETUP, recording())
    setup = found.setup
    true = {('left', 'delay'): -5e-3, ('right', 'delay'): 4e-3, ('fix', 'delay'): 0.02,
            ('left', 'mounting'): -0.5, ('right', 'mounting'): 0.515, ('fix', 'scale'): SCALE}
    sensors = setup.distances | setup.fixes
    deviations = {(name, one.field): deviation for (name, one), deviation in zip(
        found.sought, found.deviations, strict=True)}
    for (name, field), value in true.items():
        seen = getattr(sensors[name], field)
        seen = seen[0] if field == 'mounting' else seen
        assert abs(seen - value) < 3.0 * deviations[name, field]
    assert abs(setup.imu.mounting[5] - YAW) < 0.01
    assert abs(setup.fixes['fix'].delay - 0.02) < 4e-3 and deviations['fix', 'delay'] < 3e-3
    places = [one.mounting[0] for one in setup.distances.values()]
    assert places[1] - places[0] == pytest.approx(1.015, abs=4e-3)
    before, after = found.scatters['fix']
    assert after < min(before, 1.2)


def shifted(table, since, by):
    table[table[:, 0] > since] += by
    return table


def spoil_second_half(one):
    shifted(one.walls['fix'], 31.0, (-0.04, 0.0))


def spoil_unit(one):
    one.imu[:, 4:] /= 9.81


def swap(one):
    one.walls['left'], one.walls['right'] = one.walls['right'], one.walls['left']


def make_gap(one):
    shifted(one.imu, 20.0, (1.0, *6 * [0.0]))


def make_noise(one):
    one.walls['left'][:, 1] += 2e-3 * np.random.default_rng(1).standard_normal(
        len(one.walls['left']))


@pytest.mark.long
@pytest.mark.parametrize(('spoil', 'message'), [
    (spoil_second_half, 'does not hold in the second'), (spoil_unit, 'its unit seems to be g'),
    (swap, 'left and right are swapped'), (make_gap, 'a gap of 1.0'),
    (make_noise, 'left scatters by')])
def test_a_recording_that_contradicts_itself_is_rejected(spoil, message):
    one = recording()
    spoil(one)
    with pytest.raises(CalibrationError, match=message):
        fit_sensors(SETUP, one, ['delay', 'scale'])


@pytest.mark.long
def test_a_gondola_that_hardly_moves_shows_nothing_and_a_short_recording_is_too_short():
    still = recording(strength=0.02, pushes=())
    with pytest.raises(CalibrationError, match='cannot show .*fix scale.*push it'):
        fit_sensors(SETUP, still, ['scale'])
    with pytest.raises(CalibrationError, match='in common, 30 s are needed'):
        fit_sensors(SETUP, SensorRecording(still.imu[:3000], still.walls))
    with pytest.raises(ParameterError, match='roll is not one of x, delay'):
        fit_sensors(SETUP, still, ['roll'])


@pytest.mark.long
def test_the_command_writes_what_it_finds_into_the_parameters_of_the_estimator(
        tmp_path, monkeypatch, capsys):
    machine, output = tmp_path / 'machine.yaml', tmp_path / 'found.yaml'
    machine.write_text(
        '/**/disturbance_estimator:\n  ros__parameters:\n    distances: [left, right]\n'
        '    fixes: [fix]\n    poses: [""]\n    imu:\n'
        '      mounting: [0.2, -0.05, 0.1, 0.0, 0.0, 0.0]\n    left:\n'
        '      mounting: [-0.5, 0.0, 0.0]  # by a ruler\n    right:\n'
        '      mounting: [0.5, 0.0, 0.0]\n    fix: {noise: 0.0003, place_noise: 0.0002}\n')
    monkeypatch.setattr(__main__, 'read_sensors', lambda path, setup, namespace: recording())
    assert __main__.main(['sensors', 'a.mcap', '--find', 'delay', 'scale', 'yaw', '--parameters',
                          str(machine), '--output', str(output)]) == 0
    text = output.read_text()
    fix = yaml.safe_load(text)['/**/disturbance_estimator']['ros__parameters']['fix']
    assert fix['delay'] == pytest.approx(0.02, abs=4e-3) and '# by a ruler' in text
    assert fix['scale'] == pytest.approx(SCALE, abs=0.02)
    assert 'fix scale' in capsys.readouterr().out
