"""Figures and pictures of a run."""

import math
import re

import numpy as np
import pytest

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import compose, Geometry, Pose
from facade_manipulator.simulation.demo import pictures
from facade_manipulator.simulation.demo.samples import carried, Run
from facade_manipulator.simulation.world.scenario import Scenario, Wall


def run(amplitude=1e-3, force=None, **scenario):
    """Return a run with an error at 1 Hz along x [m] on a swaying gondola, and a force [N]."""
    times = 1e3 + 0.0101 * np.arange(4000)
    references = np.tile((0.1, 0.25, 0.0), (4000, 1))
    heads = references + np.outer(np.sin(math.tau * times), (amplitude, 1e-4, 1e-4))
    rails = np.tile((0.0, 0.01, 0.02), (4000, 1))
    rails[:, 0] = 0.05 * np.sin(times)
    wrenches = np.zeros((4000, 3))
    wrenches[:, 1] = 0.0 if force is None else -force
    tables = [np.column_stack((times, table)) for table in (heads, rails, references, wrenches)]
    return Run([*tables[:3], tables[3] if force is not None else ()],
               Scenario(**scenario), Geometry())


def test_figures_and_spectrum_show_the_recorded_error():
    made = run()
    assert made.times[made.is_counted][0] == pytest.approx(15.0, abs=0.02)
    assert made.rms[1, 0] == pytest.approx(1e-3 / math.sqrt(2), rel=0.02)
    assert re.fullmatch(r'x [\d.]+ → 0.7\d* mm \([\d.]+ dB\)', made.figures[0])
    panels = pictures.errors(made).axes
    frequencies, amplitude = panels[2].lines[1].get_data()
    assert frequencies[amplitude.argmax()] == pytest.approx(1.0, abs=0.03)
    assert amplitude.max() == pytest.approx(1.0, rel=0.2)  # between two bins
    assert [panel.get_ylabel()[-4:] for panel in panels[2::3]] == ['[mm]', '[mm]', ' [°]']



@pytest.mark.parametrize('yields', [False, True])
def test_axis_that_yields_to_contact_has_no_bound(yields):
    made = run(amplitude=0.05, compensator={'contact.yaw_enabled': yields})
    assert [text.split()[0] for text in made.low] == ['x'] and 'bound 20 dB' in made.low[0]
    assert ['dB' in text for text in made.figures] == [True, True, not yields]


def test_carried_points_are_composed_poses():
    rails, points = np.random.default_rng(0).normal(size=(2, 5, 3))
    assert carried(rails, points) == pytest.approx(np.array([
        compose(Pose(*rail), Pose(*point)) for rail, point in zip(rails, points, strict=True)]))


def test_moments_show_both_extremes_of_the_gondola():
    panels = pictures.moments(run()).axes
    without, error = np.array([[[float(number) for number in re.findall(r'[+-][\d.]+', line)]
                                for line in panel.get_title().split('\n')[1:]]
                               for panel in panels]).transpose(1, 0, 2)
    assert without[1, 0] < -40.0 and without[2, 0] > 40.0  # mm, from 50 sin t and the yaw
    assert np.abs(error).max() <= 1.0


def test_pressed_head_is_drawn_in_front_of_the_wall():
    lines = pictures.moments(run(wall=Wall(is_touched=True, distance=0.2))).axes[0].lines
    marks = [line for line in lines if 'last 3 s' in line.get_label()]
    assert len(marks) == 3 and all(line.get_ydata().max() == 200.0 for line in marks)


def test_noise_of_the_force_sensor_is_not_contact():
    noise = np.random.default_rng(0).normal(0.0, 0.5, 4000)
    panel, = pictures.force(run(force=noise + 30.0 * (np.arange(4000) > 3000))).axes
    share = float(re.search(r'for ([\d.]+) %', panel.get_title())[1])
    assert share == pytest.approx(25.0, abs=0.3)
    assert panel.lines[0].get_ydata()[-1] == pytest.approx(30.0, abs=1.0)


def test_run_with_too_few_samples_is_rejected():
    with pytest.raises(ManipulatorError, match='0 poses of the head since the first reference'):
        Run([()] * 4, Scenario(), Geometry())
