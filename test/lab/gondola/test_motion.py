"""The gondola's motion as sums of sines, as recorded, and by its spectrum."""

from dataclasses import replace
from functools import partial
import math

import numpy as np
import pytest

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.lab.gondola.motion import (
    load_recording,
    load_spectrum,
    recording,
    spectrum,
    Sway,
    SwaySettings,
)
from facade_manipulator.lab.gondola.scenario import Scenario

TIMES = np.arange(0.0, 10.0, 0.02)
POSES = np.column_stack([0.1 * np.sin(TIMES), 0.01 * np.cos(TIMES), 0.02 * np.sin(2 * TIMES)])
FREQUENCIES = np.arange(0.02, 1.0, 0.02)
DENSITIES = np.column_stack([
    peak / (1.0 + ((FREQUENCIES - at) / 0.03) ** 2)
    for peak, at in ((1e-2, 0.1), (1e-3, 0.2), (5e-3, 0.15))])
DENSITY = 'frequency,x_density,y_density,theta_density\n'
load_first = partial(load_spectrum, seed=1)


def test_the_default_wind_has_the_amplitudes_of_the_demo():
    sway = Sway(SwaySettings())
    course = np.array([sway.at(time) for time in np.arange(0.0, 100.0, 0.01)])
    assert course.std(axis=0) == pytest.approx(
        (math.hypot(0.1, 0.02) / math.sqrt(2), 0.015 / math.sqrt(2),
         math.radians(2.0) / math.sqrt(2)), rel=0.01)


def test_an_axis_without_sines_stands_still():
    still = {f'{axis}_{part}': () for axis in ('x', 'y', 'yaw')
             for part in ('amplitude', 'frequency', 'phase')}
    assert Sway(SwaySettings(**still)).at(3.0) == (0.0, 0.0, 0.0)


# --- as recorded

def test_what_was_recorded_is_played_back():
    motion = recording(TIMES + 500.0, POSES)
    for time in (0.0, 0.013, 3.337, 9.9):
        expected = (0.1 * math.sin(time), 0.01 * math.cos(time), 0.02 * math.sin(2 * time))
        assert motion(time) == pytest.approx(expected, abs=1e-4)


def test_at_its_end_it_is_played_backwards_without_a_step():
    motion = recording(TIMES, POSES)
    places = np.array([motion(time) for time in np.arange(0.0, 45.0, 0.005)])
    assert abs(np.diff(places, axis=0)).max() < 1e-3
    assert motion(19.9) == pytest.approx(tuple(motion(0.06)), abs=5e-3)


def test_a_file_is_read(tmp_path):
    rows = '\n'.join(','.join(map(str, (time, *pose))) for time, pose in zip(
        TIMES, POSES, strict=True))
    path = tmp_path / 'wind.csv'
    path.write_text(f'time,x,y,theta\n{rows}\n')
    assert load_recording(path)(1.0).x == pytest.approx(0.1 * math.sin(1.0), abs=1e-4)


def test_columns_may_name_their_units(tmp_path):
    path = tmp_path / 'wind.csv'
    path.write_text('time;x_mm;y_mm;theta_deg\n0;10;0;0\n1;10,5;0;180\n')
    assert load_recording(path)(0.0) == pytest.approx((0.01, 0.0, 0.0))


# --- by its spectrum

def test_a_motion_has_the_power_of_its_spectrum():
    motion = spectrum(FREQUENCIES, DENSITIES, 3)
    values = np.array([motion(time) for time in np.arange(0.0, 2000.0, 0.25)])
    power = 0.02 * (DENSITIES.sum(axis=0) - 0.5 * (DENSITIES[0] + DENSITIES[-1]))
    assert values.var(axis=0) == pytest.approx(power, rel=0.03)
    found = np.abs(np.fft.rfft(values[:, 0])) ** 2
    peak = np.fft.rfftfreq(len(values), 0.25)[np.argmax(found)]
    assert peak == pytest.approx(0.1, abs=0.04)


def test_another_seed_is_another_motion_of_the_same_power():
    one, other = (spectrum(FREQUENCIES, DENSITIES, seed) for seed in (1, 2))
    assert one(7.0) != pytest.approx(other(7.0))
    assert one(7.0) == spectrum(FREQUENCIES, DENSITIES, 1)(7.0)


def test_scenario_moves_with_the_spectrum_of_its_file(tmp_path):
    path = tmp_path / 'spectrum.csv'
    np.savetxt(path, np.column_stack([FREQUENCIES, DENSITIES]), delimiter=',', comments='',
               header=DENSITY.strip())
    base = Scenario()
    scenario = base._replace(mission=replace(
        base.mission, motion='spectrum', recording=str(path)))
    motion = scenario.motion()
    values = np.array([motion(time) for time in np.arange(0.0, 2000.0, 0.25)])
    power = 0.02 * (DENSITIES.sum(axis=0) - 0.5 * (DENSITIES[0] + DENSITIES[-1]))
    assert values.var(axis=0) == pytest.approx(power, rel=0.03)


@pytest.mark.parametrize(('load', 'text', 'message'), [
    (load_recording, 'time,x,y\n0,0,0\n', 'no column theta'),
    (load_recording, '', 'has no rows below its header'),
    (load_recording, 'time,x,y,theta\n0,0,0,0\n', '2 samples'),
    (load_recording, 'time,x,y,theta\n0,0,0,0\n1,a,0,0\n',
     r'row 2 \(line 3\): x = .a. is not a number'),
    (load_recording, 'time,x,y,theta\n0,0,0,0\n1,nan,0,0\n',
     r'row 2 \(line 3\): x = .nan. is not a number'),
    (load_recording, 'time,x,y,theta\n0,0,0,0\n1,0,0,0\n1,0,0,0\n', 'must ascend'),
    (load_recording, None, 'cannot be read'),
    (load_first, 'frequency,x_density,y_density\n0.1,1,1\n', 'has no column theta_density'),
    (load_first, f'{DENSITY}0.1,1,1,1\n', 'needs 2 rows at least'),
    (load_first, f'{DENSITY}0.2,1,1,1\n0.1,1,1,1\n',
     'must ascend from above 0 Hz, but row 2 has 0.1 Hz'),
    (load_first, f'{DENSITY}0,1,1,1\n0.1,1,1,1\n', 'but row 1 has 0 Hz'),
    (load_first, f'{DENSITY}0.1,1,1,1\n0.2,1,-2,1\n',
     'y_density = -2 in row 2 is below its minimum 0'),
    (load_first, f'{DENSITY}0.1,a,1,1\n', "x_density = 'a' is not a")])
def test_a_file_that_is_no_motion_is_rejected(tmp_path, load, text, message):
    path = tmp_path / 'bad.csv'
    if text is not None:
        path.write_text(text)
    with pytest.raises(ManipulatorError, match=message):
        load(path)
