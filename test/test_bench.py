"""The bench of the compensation."""

from dataclasses import replace
import json

import pytest

from facade_manipulator.simulation import bench
from facade_manipulator.simulation.scenario import load_scenario, make_scenario

SHORT = {'duration': 18.0, 'goals': [0.0, 0.25, 0.0]}


def short(name):
    scenario = load_scenario(name)
    return scenario._replace(mission=replace(scenario.mission, duration=18.0))


def test_the_breeze_is_compensated_as_asked():
    result = bench.judge(short('breeze'))
    assert result['x']['ratio'] < 0.02
    assert result['y']['ratio'] < 0.08
    assert result['theta']['ratio'] < 0.08
    for axis in ('x', 'y', 'theta'):
        assert result[axis]['ratio'] < result[axis]['ratio_constant_acceleration']
        assert result[axis]['ratio'] < 0.6 * result[axis]['ratio_without_prediction']
    assert result['max_step']['x_mm'] < 1.0
    assert result['max_step']['y_mm'] < 1.0
    assert result['max_step']['theta_deg'] < 0.1
    assert result['refusals'] == result['brakes'] == 0
    assert result['contact_force'] is None


def test_window_frames_are_followed_without_losing_contact():
    result = bench.judge(short('window_frames'))
    force = result['contact_force']
    assert force['rms_error_ratio'] < 0.1
    assert force['most'] < 1.5 * force['desired']
    assert force['least'] > 0.0
    assert result['y'] is None


def test_a_storm_is_survived_inside_the_workspace():
    run = bench.run_scenario(short('storm'))
    assert run.loop.refusals == []
    assert run.loop.follower.brakes == 0
    assert max(abs(step.corrected.excess.x) for step in run.steps if step.corrected) > 0.01


def test_a_drifting_estimator_is_overruled_by_the_slip_sensor():
    sections = {
        'mission': {**SHORT, 'duration': 30.0},
        'estimator': {'drift': 0.001},
        'wall': {'slip_sensor': True},
        'compensator': {'lateral': {'enabled': True}},
    }
    with_sensor, without = (
        bench.run_scenario(make_scenario({**sections, 'wall': {'slip_sensor': seen}}))
        for seen in (True, False))
    assert abs(without.steps[-1].sample.error.x) > 0.02
    assert abs(with_sensor.steps[-1].sample.error.x) < 0.004


@pytest.mark.parametrize('frequency', [0.05, 0.5, 2.0, 5.0])
def test_no_frequency_of_the_sweep_is_amplified(frequency, monkeypatch):
    monkeypatch.setattr(bench, 'SWEEP', (frequency,))
    assert bench.sweep()[0]['ratio'] < 1.0


def test_the_report_is_written_and_told(tmp_path, capsys, monkeypatch):
    scenario = tmp_path / 'short.yaml'
    scenario.write_text('mission: {duration: 8.0, goals: [0.0, 0.25, 0.0]}')
    monkeypatch.setattr(bench, 'SWEEP', (0.5,))
    assert bench.main(['--scenario', str(scenario), '--output', str(tmp_path / 'report')]) == 0
    report = json.loads((tmp_path / 'report' / 'compensation.json').read_text())
    assert set(report) == {'scenarios', 'sweep'}
    assert report['sweep'][0]['frequency_hz'] == 0.5
    assert set(report['scenarios'][str(scenario)]['x']) >= {
        'disturbance_rms', 'residual_rms', 'ratio', 'ratio_without_prediction'}
    assert 'sweep: 0.5 Hz' in capsys.readouterr().out


def test_an_unknown_scenario_is_a_sentence_and_a_status(capsys, tmp_path):
    assert bench.main(['--scenario', 'tornado', '--output', str(tmp_path)]) == 2
    assert 'tornado' in capsys.readouterr().err
