"""Figures and pictures of a run."""

import math
import re
from unittest.mock import Mock

import numpy as np
import pytest

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.simulation.demo import demo, demo_report
from facade_manipulator.simulation.demo.demo_report import Run
from facade_manipulator.simulation.world.scenario import Mission, Scenario


def run(amplitude=1e-3, force=None, samples=4000, **scenario):
    """Return a run with an error at 1 Hz along x [m] on a swaying gondola, and a force [N]."""
    times = 1e3 + 0.0101 * np.arange(samples)
    references = np.tile((0.1, 0.25, 0.0), (samples, 1))
    error = np.outer(np.sin(math.tau * times), (amplitude, 1e-4, 1e-4))
    heads = references + error
    rails = np.tile((0.0, 0.01, 0.02), (samples, 1))
    rails[:, 0] = 0.05 * np.sin(times)
    wrenches = np.zeros((samples, 3))
    wrenches[:, 1] = 0.0 if force is None else -force

    def table(values):
        return np.column_stack((times, values))

    tables = [table(heads), table(rails), table(references)]
    tables.append(() if force is None else table(wrenches))
    return Run(tables, Scenario(**scenario))


def test_figures_and_spectrum_show_the_recorded_error():
    made = run()
    assert made.times[made.is_counted][0] == pytest.approx(15.0, abs=0.02)
    sway = math.hypot(0.05 / math.sqrt(2), 0.005)
    assert made.rms[0, 0] == pytest.approx(sway, rel=0.05)
    assert made.rms[0, 1] == pytest.approx(1e-3 / math.sqrt(2), rel=0.02)
    assert re.fullmatch(r'x 35[\d.]* → 0.7\d* mm \([\d.]+ dB\)', made.figures[0])
    over_time, by_frequency, *_ = demo_report.errors(made).axes
    assert len(over_time.patches) == 1  # not counted at the begin
    frequencies, amplitude = by_frequency.lines[1].get_data()
    assert frequencies[amplitude.argmax()] == pytest.approx(1.0, abs=0.03)
    assert amplitude.max() == pytest.approx(1.0, rel=0.2)  # between two bins


def test_line_over_time_is_the_rms_of_each_second():
    over_time = demo_report.errors(run(amplitude=1e-3)).axes[0]
    _, compensated = over_time.lines
    assert compensated.get_ydata() == pytest.approx(1.0 / math.sqrt(2), rel=0.02)


def test_picture_of_the_errors_labels_six_panels_with_units():
    panels = demo_report.errors(run()).axes
    labels = [panel.get_ylabel() for panel in panels]
    assert len(labels) == 6
    assert all('[' in label for label in labels)


def test_amplification_is_explained_above_the_first_spectrum():
    panels = demo_report.errors(run()).axes
    explained = [demo_report.AMPLIFICATION in panel.get_title() for panel in panels]
    assert explained == [False, True, False, False, False, False]


def test_animation_lasts_as_long_as_a_short_run():
    made = run(samples=110)
    duration = demo_report.FRAME_PERIOD * len(demo_report.linkage(made))
    assert duration == pytest.approx(made.times[-1], abs=demo_report.FRAME_PERIOD)


@pytest.fixture
def panel():
    return demo_report.figure(8, 5.5, '').subplots()


def test_animation_draws_the_mechanism_with_and_without_compensation(panel):
    made = run()
    demo_report.draw_moment(panel, made, 100)
    starts = np.array([line.get_xydata()[0] for line in panel.lines])
    opacities = [line.get_alpha() for line in panel.lines]
    for path, opacity in zip(made.paths, (demo_report.GHOST, 1.0), strict=False):
        distances = np.linalg.norm(starts - 1e3 * path[100, :2], axis=1)
        assert distances.min() == pytest.approx(0.0, abs=0.1)
        assert opacity in opacities


def test_animation_draws_the_wall_at_its_distance(panel):
    made = run()
    demo_report.draw_moment(panel, made, 100)
    (wall,) = (patch for patch in panel.patches if patch.get_label() == 'wall')
    assert wall.get_y() == pytest.approx(1e3 * made.scenario.wall.distance)


@pytest.mark.parametrize('yields', [False, True])
def test_axis_that_yields_to_contact_has_no_limit(yields):
    mission = Mission(attenuation=(20.0, 12.0, -math.inf if yields else 12.0))
    made = run(amplitude=0.05, mission=mission)
    assert [text.split()[0] for text in made.low] == ['x']
    assert 'below the limit 20 dB' in made.low[0]
    assert ['dB' in text for text in made.figures] == [True, True, not yields]


def demo_of(scenario, folder, duration):
    return Mock(
        output=folder,
        duration=duration,
        scenario=scenario,
        counters=dict,
        priority=0,
        scheduling='no real-time priority',
    )


def test_low_attenuation_fails_only_a_long_demo(tmp_path, monkeypatch):
    monkeypatch.setattr(demo_report, 'draw', Mock(return_value={}))
    monkeypatch.setattr(demo, 'handle_signals', Mock())
    made = run(amplitude=0.05)
    demo.Demo.report(demo_of(made.scenario, tmp_path, 9.0), made)
    longer = demo_of(made.scenario, tmp_path, 11.0)
    with pytest.raises(ManipulatorError, match='attenuation too low: x .*no real-time'):
        demo.Demo.report(longer, made)


def test_noise_of_the_force_sensor_is_not_contact():
    noise = np.random.default_rng(0).normal(0.0, 0.5, 4000)
    contact = 30.0 * (np.arange(4000) > 3000)
    (panel,) = demo_report.force(run(force=noise + contact)).axes
    share = float(re.search(r'for ([\d.]+) %', panel.get_title())[1])
    assert share == pytest.approx(25.0, abs=0.3)
    assert panel.lines[0].get_ydata()[-1] == pytest.approx(30.0, abs=1.0)


def test_run_with_too_few_samples_is_rejected():
    with pytest.raises(ManipulatorError, match='since the first reference, minimum'):
        Run([()] * 4, Scenario())
