"""Mounting and delay of the estimator, found from a recording."""

from copy import deepcopy
from functools import cache
import math
from pathlib import Path

from made_up_machines import record_estimator, wandering
import numpy as np
import pytest
import yaml

from facade_manipulator.errors import CalibrationError, ParameterError
from facade_manipulator.kinematics import compose, Geometry, Pose, relative
from facade_manipulator.lab.gondola.motion import Sway, SwaySettings
from facade_manipulator.lab.gondola.sensors import EstimatorSettings
from facade_manipulator.prediction.estimate import EstimateSettings
from facade_manipulator.tools.calibration import __main__ as calibrate
from facade_manipulator.tools.calibration.estimator_fit import fit_estimator

pytestmark = pytest.mark.long

GEOMETRY = Geometry()
BREEZE = Sway(SwaySettings())
NOISE = (1e-3, 1e-3, 1e-3)
MOUNTING = (0.5, 0.3, math.radians(0.5))
LIMITS = np.array([5e-3, 5e-3, math.radians(0.05), 3e-3])


def compensated(time):
    return relative(BREEZE.at(time), Pose(0.0, 0.25, 0.0))


def values(found):
    return (*found.settings.mounting, found.settings.delay)


@cache
def recorded(head=wandering, motion=BREEZE.at, late=0.0, **settings):
    return record_estimator(motion, EstimatorSettings(**settings), GEOMETRY, head, late)


def record(mounting=MOUNTING, delay=0.02, **changes):
    return deepcopy(recorded(mounting=mounting, stamp_error=delay, **changes))


def drifting(wall):
    wall[:, 1] += 1.5e-4 * wall[:, 0]


def knocked(wall):
    for row in wall[wall[:, 0] > 70.0]:
        wall[wall[:, 0] == row[0], 1:] = compose(Pose(0.02, -0.01, 0.005), Pose(*row[1:]))


def with_outliers(wall):
    wall[::20, 1] += 0.2


@pytest.mark.parametrize(('head', 'seed', 'spoil', 'changes'), [
    (compensated, 0, None, {}), (wandering, 1, None, {}), (wandering, 2, drifting, {}),
    (wandering, 3, knocked, {}), (wandering, 4, with_outliers, {}),
    (wandering, 5, None, {'position_noise': 2e-3, 'yaw_noise': 3.4e-3, 'drift': 5e-5})])
def test_two_minutes_of_breeze_show_mounting_and_delay_whatever_the_instrument_does(
        head, seed, spoil, changes):
    random = np.random.default_rng(seed)
    mounting = (*random.uniform(-1.0, 1.0, 2).tolist(), random.normal(0.0, 0.02))
    delay, late = random.uniform(-0.05, 0.05), random.uniform(0.0, 0.05)
    recording = record(mounting, delay, seed=seed, head=head, late=late, **changes)
    if spoil is not None:
        spoil(recording.wall)
    found = fit_estimator(GEOMETRY, recording)
    off = np.abs(np.subtract(values(found), (*mounting, delay)))
    assert (off < LIMITS).all()
    assert (off < 4.0 * np.array([*found.deviations.values()])).all()
    assert found.residual == pytest.approx(NOISE, rel=0.4)
    assert head is compensated or found.late == pytest.approx(late, abs=4e-3)
    assert (found.drift[0] > 0.01) == (spoil in (drifting, knocked))
    assert found.knocked == (pytest.approx(70.0, abs=3.0) if spoil is knocked else math.inf)


def test_stamps_since_1970_are_as_good():
    recording = record()
    for table in recording:
        table[:, 0] += 1.8e9
    found = fit_estimator(GEOMETRY, recording)
    assert (np.abs(np.subtract(values(found), (*MOUNTING, 0.02))) < LIMITS).all()


def test_the_origin_of_the_second_measurement_does_not_matter():
    recording = record()
    tracker = Pose(3.0, -1.0, 0.1)
    wall = np.array([(time, *compose(tracker, Pose(*head))) for time, *head in recording.wall])
    found = fit_estimator(GEOMETRY, recording._replace(wall=wall))
    assert np.abs(np.subtract(values(found), (*MOUNTING, 0.02))).max() < 5e-3
    assert found.turn == pytest.approx(0.1, abs=2e-3)


def test_a_camera_that_sees_no_angle_is_enough_while_the_carriages_move():
    recording = record()
    recording.wall[:, 3] = np.nan
    found = fit_estimator(GEOMETRY, recording)
    off = np.subtract(values(found), (*MOUNTING, 0.02))
    assert (np.abs(off) < 4.0 * np.array([*found.deviations.values()])).all()
    assert math.isnan(found.residual[2])


def test_axes_that_are_turned_are_found_by_a_second_measurement_along_those_of_facade():
    found = fit_estimator(GEOMETRY, record(axes=0.3), ('x', 'y', 'yaw', 'delay', 'axes'))
    assert found.settings.axes == pytest.approx(0.3, abs=math.radians(0.05))
    assert (np.abs(np.subtract(values(found), (*MOUNTING, 0.02))) < LIMITS).all()
    with pytest.raises(ParameterError, match='turn is not one of x, y, yaw, delay, axes'):
        fit_estimator(GEOMETRY, record(), ('turn',))


def slipping(recording):
    """Return what `lateral_offset` shows of it: x alone, while a goal stands."""
    wall = recording.wall[recording.wall[:, 0] % 6.0 > 2.5]
    wall[:, 2:] = np.nan
    return recording._replace(wall=wall)


def test_the_slip_along_the_wall_shows_the_delay_and_the_lever_arm_alone():
    recording, present = slipping(record()), EstimateSettings(mounting=(0.5, 0.0, MOUNTING[2]))
    with pytest.raises(CalibrationError, match='look for less with --find y delay'):
        fit_estimator(GEOMETRY, recording, present=present)
    found = fit_estimator(GEOMETRY, recording, ('y', 'delay'), present)
    assert (np.abs(np.subtract(values(found), (*MOUNTING, 0.02))) < LIMITS).all()
    assert found.settings.mounting[::2] == present.mounting[::2]
    assert list(found.deviations) == ['y', 'delay']


def still(_):
    return Pose(0.0, 0.0, 0.0)


def standing(_):
    return Pose(0.0, 0.25, 0.0)


def sliding(time):
    return BREEZE.at(time)._replace(theta=0.0)


@pytest.mark.parametrize(('changes', 'message'), [
    ({'motion': still}, 'cannot show .* swayed by 0.00.* mm, 0.00'),
    ({'motion': sliding}, 'cannot show x of the mounting'),
    ({'head': standing, 'late': 0.03}, 'cannot show delay .* the head moved on the rail '
     'by 0.* mm.*a delay the head to move on the rail'),
    ({'late': 2.3}, 'wall are [+-]2.3 s late'), ({'late': -4.0}, 'wall are [+-]4.0 s late'),
    ({'silent_from': 30.0, 'silent_for': 2.0}, 'disturbance: a gap of 2')])
def test_what_a_recording_does_not_show_or_contradicts_is_named(changes, message):
    with pytest.raises(CalibrationError, match=message):
        fit_estimator(GEOMETRY, record(**changes))


def times(table, column, factor):
    def change(recording):
        getattr(recording, table)[:, column] *= factor

    return change


def empty(recording):
    recording.wall[:, 1:] = np.nan


def open_links(recording):
    recording.joints[(recording.joints[:, 0] >= 20.0) & (recording.joints[:, 0] < 21.0), 1] *= 9.0


def stand_still(recording):
    recording.joints[7, 0] = recording.joints[6, 0]


@pytest.mark.parametrize(('spoil', 'message'), [
    (times('disturbance', 1, 1e-3), r'contradict each other.*wall shows .*9\d\d times x'),
    (times('disturbance', 1, -1.0), r'contradict each other.*wall shows .*-0.9\d* times x'),
    (times('wall', 3, math.radians(1.0)),
     r'contradict each other.*wall shows .*0.017\d* times theta'),
    (empty, 'wall: nothing of x, y, theta is measured'),
    (open_links, 'joints: (19.9|20.0). s .* links do not close'),
    (stand_still, 'joints: the time must ascend, row 8')])
def test_another_unit_sign_or_order_of_time_is_named(spoil, message):
    recording = record(yaw_noise=1e-4, position_noise=1e-4)
    spoil(recording)
    with pytest.raises(CalibrationError, match=message):
        fit_estimator(GEOMETRY, recording)


def test_recordings_that_do_not_overlap_are_rejected():
    recording = record()
    with pytest.raises(CalibrationError, match='in common'):
        fit_estimator(GEOMETRY, recording._replace(disturbance=recording.disturbance[:500]))


def test_the_command_writes_mounting_and_delay_for_the_compensator(tmp_path, monkeypatch, capsys):
    asked = []
    monkeypatch.setattr(calibrate, 'read_estimator_recording', lambda *args: (
        asked.append(args) or record()))
    target = tmp_path / 'calibrated.yaml'
    assert calibrate.main(['estimator', 'a.mcap', '--output', str(target)]) == 0
    assert asked == [(Path('a.mcap'), 'head_on_wall', '')]
    assert 'delay' in capsys.readouterr().out
    estimate = yaml.safe_load(target.read_text())['/**/compensator']['ros__parameters']['estimate']
    assert estimate['mounting'] == pytest.approx(MOUNTING, abs=5e-3)
    assert estimate['delay'] == pytest.approx(0.02, abs=3e-3)
