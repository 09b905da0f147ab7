"""What the demo records, the figures of a run and what its pictures show."""

import math
import re

import numpy as np
import pytest

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import compose, Geometry, Pose
from facade_manipulator.nodes.conversions import pose_stamped
from facade_manipulator.simulation.demo import pictures
from facade_manipulator.simulation.demo.linkage import before_and_after
from facade_manipulator.simulation.demo.recording import carried, figures, Recorder, run_of
from facade_manipulator.simulation.world.scenario import Scenario
from facade_manipulator.topics import GOAL_POSE, HEAD_POSE, RAIL_POSE, REFERENCE


class Tables(dict):
    """What a recorder has recorded, by topic."""

    def table(self, topic):
        return np.array(self.get(topic, [])).reshape(-1, 4)


@pytest.fixture(scope='module')
def run():
    """Return a run with an error of 1 mm at 1 Hz along x, while goals leap by 100 mm."""
    tables, begin = Tables(), 1000.0
    for k in range(4000):
        time = 0.0101 * k
        reference = Pose(0.1 * abs(1.0 - time / 6.0 % 2.0), 0.25, 0.0)
        error = np.multiply((1.0, 0.1, 0.1), 1e-3 * math.sin(6.2832 * time))
        for topic, pose in ((HEAD_POSE, reference + error), (REFERENCE, reference),
                            (RAIL_POSE, (0.05 * math.sin(time), 0.01, 0.02))):
            tables.setdefault(topic, []).append((begin + time, *pose))
        if k % 100 == 0:
            goal = (0.1 * (time // 6.0 % 2), 0.25, 0.0)
            tables.setdefault(GOAL_POSE, []).append((begin + time, *goal))
    return run_of(tables)


def test_error_of_a_millimetre_is_one_in_figures_and_spectrum(run):
    assert 0.2 < run.is_counted.mean() < 0.5 and not run.is_counted[run.times < 15.0].any()
    assert figures(run)['x']['residual_rms'] == pytest.approx(1e-3 / math.sqrt(2), rel=0.02)
    panel = pictures.spectrum(run).axes[0]
    frequencies, amplitude = panel.lines[1].get_data()
    assert frequencies[amplitude.argmax()] == pytest.approx(1.0, abs=0.03)
    assert amplitude.max() == pytest.approx(1.0, rel=0.2)  # between two bins
    assert amplitude[frequencies > 3.0].max() < 0.1  # mm, although goals leap


def test_spectrum_names_the_unit_of_each_axis(run):
    panels = pictures.spectrum(run).axes
    assert [panel.get_ylabel() for panel in panels[:3]] == [
        f'amplitude [{unit}]' for unit in ('mm', 'mm', '°')]


def test_carried_points_are_composed_poses():
    rails, points = np.random.default_rng(0).normal(size=(2, 5, 3))
    assert carried(rails, points) == pytest.approx(np.array([
        compose(Pose(*rail), Pose(*point)) for rail, point in zip(rails, points, strict=True)]))


@pytest.mark.parametrize(('length', 'is_drawn'), [(0.352, True), (0.2, False)])
def test_before_and_after_shows_rest_and_both_extremes(run, length, is_drawn):
    panels = before_and_after(run._replace(geometry=Geometry(length))).axes
    offsets = [[float(number) for number in re.findall(r'[+-][\d.]+', panel.get_title())]
               for panel in panels]
    assert offsets[1][0] < -40.0 and offsets[2][0] > 40.0  # mm, from 50 sin t and the yaw
    assert all(abs(number) <= 1.0 for panel in offsets[3:] for number in panel)
    assert len(panels[5].lines) == (18 if is_drawn else 7)
    assert not {'gondola', 'goal'} - {line.get_label() for line in panels[0].lines}


def test_yielding_axis_has_no_attenuation_in_its_title(run):
    panels = pictures.time_courses(run._replace(
        scenario=Scenario(compensator={'contact.enabled': True}))).axes[::2]
    assert ['dB' in panel.get_title('left') for panel in panels] == [True, False, True]


def test_noise_of_the_force_sensor_is_no_contact(run):
    noise = np.random.default_rng(0).normal(0.0, 0.5, len(run.times))
    pressed = run._replace(forces=noise + 30.0 * (run.times > 0.75 * run.times[-1]))
    title = pictures.force(pressed).axes[0].get_title('left')
    assert float(re.search(r'for ([\d.]+) %', title)[1]) == pytest.approx(25.0, abs=0.3)


def test_run_with_too_few_samples_is_rejected():
    with pytest.raises(ManipulatorError, match='0 poses of the head since the first of 0 goals'):
        run_of(Tables())


def test_recorder_keeps_valid_messages_once_in_order(ros):
    node = ros.node('recorder')
    recorder, heads = Recorder(node), node.create_publisher(*HEAD_POSE)
    ros.until(heads.get_subscription_count, 'the subscription of the recorder')
    assert recorder.error() is None
    for stamp, x in ((3.0, math.nan), (2.0, 0.2), (1.0, 0.1), (2.0, 0.3)):
        heads.publish(pose_stamped('facade', stamp, Pose(x, 0.25, 0.0)))
    ros.until(lambda: len(recorder.series[HEAD_POSE]) == 3, 'the valid messages')
    assert recorder.table(HEAD_POSE)[:, :2].tolist() == [[1.0, 0.1], [2.0, 0.2]]
    recorder.series[REFERENCE].extend([(1.0, 0.0, 0.25, 0.0), (3.0, 0.4, 0.25, 0.0)])
    assert recorder.error() == pytest.approx((0.1, 0.0, 0.0))  # at the stamp of the head
