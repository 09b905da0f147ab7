"""The demo as an operator runs it: a process, its report, and its end after Ctrl-C."""

import json
import os
from pathlib import Path
import re
import signal
import time
from types import SimpleNamespace

import pytest
from support import children, DEADLINE, patiently, wait_until

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.parameters import read_parameters
from facade_manipulator.simulation.demo import demo as demo_module
from facade_manipulator.simulation.demo.demo import cycles_text, Demo, require_attenuation
from facade_manipulator.simulation.world.scenario import load_scenario, scenario_names

DEMO = 'facade_manipulator.simulation.demo.demo'
SETTLED = 10.0  # s
RUN_DEADLINE = 90.0  # s
FREEZE = 1.0  # s, far beyond what drives forgive
LARGEST_ANIMATION = 2_000_000  # bytes
ANSWER = 1.0  # s
PROMPT = 3.0  # s; the nodes need 1 s to end
COUNTERS = {'bus_cycles': 1000, 'late_cycles': 4, 'missed_cycles': 0, 'drive_faults': 0,
            'rejected_goals': 0}
BUSY = {**COUNTERS, 'missed_cycles': 2}


@pytest.fixture
def demo(monkeypatch, tmp_path):
    """Return a function that makes a demo without nodes."""
    monkeypatch.setattr(demo_module, 'ManipulatorClient', lambda *_: SimpleNamespace(node=None))
    monkeypatch.setattr(demo_module, 'Recorder', lambda node: None)
    monkeypatch.setattr(demo_module.subprocess, 'Popen', lambda *_, **options: None)
    return lambda scenario, duration=None: Demo(SimpleNamespace(
        output=tmp_path, scenario=scenario, duration=duration, viewer=False))


@pytest.mark.parametrize(('duration', 'used', 'printed'), [
    (None, load_scenario('flips').mission.duration, ''),
    (10.0, 10.0, 'too short to show the second without estimates; next: set a duration of 25 s')])
def test_short_duration_names_missing_event(demo, capsys, duration, used, printed):
    made = demo('flips', duration)
    made._start_nodes()
    output = capsys.readouterr().out
    assert made.duration == used
    assert printed in output and ('too short' in output) == bool(printed)


def test_nodes_start_with_the_parameters_of_the_scenario(demo, tmp_path):
    demo('pressing')._start_nodes()
    files = [*demo_module.PARAMETER_FILES, tmp_path / 'scenario.yaml']
    assert read_parameters(files, 'gondola_simulator')['scenario'] == 'pressing'
    assert read_parameters(files, 'compensator')['contact.force'] == 30.0


@pytest.mark.parametrize('name', scenario_names())
def test_default_duration_of_a_scenario_shows_its_event(name):
    mission = load_scenario(name).mission
    assert mission.duration >= mission.shown_after


def test_start_removes_only_files_of_an_earlier_report(demo, tmp_path):
    old = ('summary.json', 'force.png', 'linkage.gif', 'disturbance_estimator.log')
    for name in (*old, 'notes.txt', 'other.log'):
        (tmp_path / name).write_text('earlier')
    demo('breeze')._start_nodes()
    assert {path.name for path in tmp_path.iterdir()} == {
        'notes.txt', 'other.log', 'scenario.yaml', 'driver.log', 'gondola_simulator.log',
        'manipulator.log'}


@pytest.mark.parametrize(('counters', 'is_busy'), [(COUNTERS, False), (BUSY, True)])
def test_low_attenuation_is_rejected_with_late_cycles(run, counters, is_busy):
    assert ('too busy' in cycles_text(counters)) == is_busy
    require_attenuation(run, counters)
    with pytest.raises(ManipulatorError, match='x .* dB.*, bound 20 dB.* 4 late') as raised:
        require_attenuation(run._replace(heads=run.still), counters)
    assert ('too busy' in str(raised.value)) == is_busy


def ended(process):
    return process.poll() is not None


def are_gone(pids):
    return not any(Path(f'/proc/{pid}').exists() for pid in pids)


def test_run_compensates_and_leaves_its_report(start_process, tmp_path):
    folder = tmp_path / 'report'

    def run():
        process = start_process(DEMO, '--duration', str(SETTLED), '--output', str(folder))
        wait_until(lambda: ended(process), 'the end of the demo', RUN_DEADLINE)
        text = process.log.read_text()
        assert process.returncode == 0, text
        return text, json.loads((folder / 'summary.json').read_text())

    text, summary = patiently(run)  # a busy computer delays the simulated world
    assert summary['axes']['x']['attenuation_db'] >= 20.0
    assert summary['bus_cycles'] > 50 * SETTLED
    assert summary['drive_faults'] == summary['rejected_goals'] == 0
    for name in ('time_courses.png', 'spectrum.png', 'path.png', 'before_after.png'):
        assert (folder / name).read_bytes().startswith(b'\x89PNG')
    animation = (folder / 'linkage.gif').read_bytes()
    assert animation.startswith(b'GIF89a') and len(animation) <= LARGEST_ANIMATION
    assert not (folder / 'force.png').exists()  # there is no wall to touch
    assert 'without → with compensation' in text and 'Traceback' not in text


@pytest.mark.parametrize(('moment', 'deadline'), [
    ('starting', PROMPT), ('driver: home', DEADLINE), (' 0.0 s ', DEADLINE)])
def test_ctrl_c_is_answered_and_leaves_nothing_running(start_process, tmp_path, moment, deadline):
    process = start_process(DEMO, '--duration', '60', '--output', str(tmp_path / 'report'))
    wait_until(lambda: moment in process.log.read_text(), f'"{moment}"', RUN_DEADLINE)
    nodes = children(process.pid)
    os.kill(process.pid, signal.SIGINT)
    wait_until(lambda: 'interrupted: stopping' in process.log.read_text(), 'the answer', ANSWER)
    wait_until(lambda: ended(process), 'the end of the demo', deadline)
    text = process.log.read_text()
    assert process.returncode == 130, text
    assert 'interrupted: drives stopped, nodes ended' in text and 'Traceback' not in text
    wait_until(lambda: are_gone(nodes), 'the nodes to end', ANSWER)


def test_ctrl_c_while_drawing_leaves_only_complete_files(start_process, tmp_path):
    process = start_process(DEMO, '--duration', '1', '--output', str(tmp_path / 'report'))
    wait_until(
        lambda: 'drawing the pictures' in process.log.read_text(), 'the drawing', RUN_DEADLINE)
    os.kill(process.pid, signal.SIGINT)
    wait_until(lambda: ended(process), 'the end of the demo')
    assert process.returncode == 130 and 'Traceback' not in process.log.read_text()
    assert not list((tmp_path / 'report').glob('.drafts_*'))
    assert not (tmp_path / 'report' / 'linkage.gif').exists()
    assert json.loads((tmp_path / 'report' / 'summary.json').read_text())


def test_killed_demo_takes_its_nodes_with_it(start_process, tmp_path):
    process = start_process(DEMO, '--duration', '60', '--output', str(tmp_path / 'report'))
    wait_until(lambda: ' 0.0 s ' in process.log.read_text(), 'the first line', RUN_DEADLINE)
    nodes = children(process.pid)
    assert len(nodes) == 3
    os.kill(process.pid, signal.SIGKILL)
    wait_until(lambda: are_gone(nodes), 'the nodes to end')


@pytest.mark.parametrize(('arguments', 'message'), [
    (('--duration', '0'), 'argument --duration: 0 is not a finite number above 0'),
    (('--output', '/proc/nowhere'), "No such file or directory: '/proc/nowhere'"),
    (('--viewer',), 'this computer has no display .*; next: run it without the viewer'),
])
def test_bad_arguments_are_one_sentence_and_exit_status_2(
        start_process, monkeypatch, arguments, message):
    for variable in ('DISPLAY', 'WAYLAND_DISPLAY'):
        monkeypatch.delenv(variable, raising=False)
    process = start_process(DEMO, *arguments)
    wait_until(lambda: ended(process), 'the end of the demo')
    assert process.returncode == 2
    assert re.search(message, process.log.read_text())
    assert 'Traceback' not in process.log.read_text()


def test_drives_that_stop_end_the_demo_with_the_reason(start_process, tmp_path):
    process = start_process(DEMO, '--duration', '60', '--output', str(tmp_path / 'report'))
    wait_until(lambda: ' 0.0 s ' in process.log.read_text(), 'the first line', RUN_DEADLINE)
    driver = next(pid for pid in children(process.pid)
                  if b'nodes.driver' in Path(f'/proc/{pid}/cmdline').read_bytes())
    loop, = children(driver)
    os.kill(loop, signal.SIGSTOP)
    wait_until(lambda: Path(f'/proc/{loop}/stat').read_text().split()[2] == 'T', 'the freeze')
    time.sleep(FREEZE)
    os.kill(loop, signal.SIGCONT)
    wait_until(lambda: ended(process), 'the end of the demo', RUN_DEADLINE)
    assert process.returncode == 1
    assert re.search('demo: driver: stopped: .*; next: ', process.log.read_text())
