"""Rows that the demo records, the figures of a run and its pictures."""

import math
import re

import numpy as np
import pytest

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import compose, Geometry, Pose
from facade_manipulator.nodes.conversions import pose_stamped
from facade_manipulator.simulation.demo import pictures
from facade_manipulator.simulation.demo.recording import carried, Recorder, run_of, TOPICS
from facade_manipulator.simulation.world.scenario import Scenario, Wall
from facade_manipulator.topics import HEAD_POSE


def test_figures_and_spectrum_show_the_recorded_error(run):
    assert run.times[run.is_counted][0] == pytest.approx(15.0, abs=0.02)
    assert run.attenuation()[1, 0] == pytest.approx(1e-3 / math.sqrt(2), rel=0.02)
    assert re.fullmatch(r'x [\d.]+ → 0.7\d* mm \([\d.]+ dB\)', run.figures()[0])
    panels = pictures.spectrum(run).axes
    frequencies, amplitude = panels[0].lines[1].get_data()
    assert frequencies[amplitude.argmax()] == pytest.approx(1.0, abs=0.03)
    assert amplitude.max() == pytest.approx(1.0, rel=0.2)  # between two bins
    assert [panel.get_ylabel() for panel in panels] == [
        f'amplitude of the error [{unit}]' for unit in ('mm', 'mm', '°')]


def test_carried_points_are_composed_poses():
    rails, points = np.random.default_rng(0).normal(size=(2, 5, 3))
    assert carried(rails, points) == pytest.approx(np.array([
        compose(Pose(*rail), Pose(*point)) for rail, point in zip(rails, points, strict=True)]))


@pytest.mark.parametrize(('length', 'is_drawn'), [(0.352, True), (0.2, False)])
def test_before_and_after_shows_rest_and_both_extremes(run, length, is_drawn):
    panels = pictures.before_after(run._replace(geometry=Geometry(length))).axes
    offsets = [[float(number) for number in re.findall(r'[+-][\d.]+', panel.get_title())]
               for panel in panels]
    assert offsets[1][0] < -40.0 and offsets[2][0] > 40.0  # mm, from 50 sin t and the yaw
    assert all(abs(number) <= 1.0 for panel in offsets[3:] for number in panel)
    assert (len(panels[5].lines) > 4) == is_drawn
    assert not {'gondola', 'where the head should be, last 3 s'} - {
        line.get_label() for line in panels[0].lines}


def test_yielding_axis_has_no_attenuation_in_its_title(run):
    panels = pictures.time_courses(run._replace(
        scenario=Scenario(compensator={'contact.enabled': True}))).axes[::2]
    assert ['dB' in panel.get_title() for panel in panels] == [True, False, True]


def test_pressed_head_is_drawn_in_front_of_the_wall(run):
    pressed = run._replace(scenario=Scenario(wall=Wall(is_touched=True, distance=0.2)))
    lines = pictures.before_after(pressed).axes[3].lines
    marks = [line for line in lines if 'last 3 s' in line.get_label()]
    assert len(marks) == 2  # the reference over the head
    assert all(line.get_ydata().max() == 200.0 for line in marks)


def test_noise_of_the_force_sensor_is_not_contact(run):
    noise = np.random.default_rng(0).normal(0.0, 0.5, len(run.times))
    pressed = run._replace(forces=noise + 30.0 * (run.times > 0.75 * run.times[-1]))
    title = pictures.force(pressed).axes[0].get_title()
    assert float(re.search(r'for ([\d.]+) %', title)[1]) == pytest.approx(25.0, abs=0.3)


def test_run_with_too_few_samples_is_rejected():
    with pytest.raises(ManipulatorError, match='0 poses of the head since the first reference'):
        run_of(dict.fromkeys(TOPICS, ()), Scenario(), Geometry())


def test_recorder_keeps_only_valid_messages(ros):
    node = ros.node('recorder')
    recorder, heads = Recorder(node), node.create_publisher(*HEAD_POSE)
    ros.until(heads.get_subscription_count, 'the subscription of the recorder')
    for stamp, x in ((3.0, math.nan), (1.0, 0.1), (2.0, 0.3)):
        heads.publish(pose_stamped('facade', stamp, Pose(x, 0.25, 0.0)))
    ros.until(lambda: len(recorder.rows[HEAD_POSE]) == 2, 'the valid messages')
    assert recorder.latest(1)[HEAD_POSE] == [(2.0, 0.3, 0.25, 0.0)]
