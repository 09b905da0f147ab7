"""The demo as people run it: a process, its report, and what is left after Ctrl-C."""

import json
import os
from pathlib import Path
import signal

import pytest
from support import wait_until

DEMO = 'facade_manipulator.nodes.demo'
SETTLED = 10.0
RUN_DEADLINE = 60.0


def children(pid):
    """Return the process ids whose parent is `pid`."""
    found = []
    for stat in Path('/proc').glob('[0-9]*/stat'):
        try:
            fields = stat.read_text().rsplit(')', 1)[1].split()
        except OSError:
            continue
        if int(fields[1]) == pid:
            found.append(int(stat.parent.name))
    return found


def ended(process):
    return process.poll() is not None


def test_a_run_compensates_and_leaves_its_report(start_process, tmp_path):
    process = start_process(DEMO, '--duration', str(SETTLED), '--output', str(tmp_path / 'report'))
    wait_until(lambda: ended(process), 'the end of the demo', RUN_DEADLINE)
    text = process.log.read_text()
    assert process.returncode == 0, text
    summary = json.loads((tmp_path / 'report' / 'summary.json').read_text())
    for axis, attenuation in (('x', 20.0), ('y', 12.0), ('theta', 12.0)):
        assert summary['axes'][axis]['attenuation_db'] >= attenuation, text
        assert summary['axes'][axis]['residual_rms'] < summary['axes'][axis]['disturbance_rms']
    assert summary['duration_s'] >= SETTLED
    assert summary['bus_cycles'] > 50 * SETTLED
    assert summary['drive_faults'] == summary['refused_goals'] == 0
    assert 0.0 < summary['pipeline_latency_ms']['p50'] <= summary['pipeline_latency_ms']['p99']
    assert (tmp_path / 'report' / 'time_courses.png').read_bytes().startswith(b'\x89PNG')
    assert 'uncompensated' in text and 'Traceback' not in text


@pytest.mark.parametrize('moment', ['starting', 'driver: home', ' 0.0 s '])
def test_ctrl_c_at_any_moment_leaves_nothing_running(start_process, tmp_path, moment):
    process = start_process(DEMO, '--duration', '60', '--output', str(tmp_path / 'report'))
    wait_until(lambda: moment in process.log.read_text(), f'"{moment}"', RUN_DEADLINE)
    nodes = children(process.pid)
    os.kill(process.pid, signal.SIGINT)
    wait_until(lambda: ended(process), 'the end of the demo')
    text = process.log.read_text()
    assert process.returncode == 130, text
    assert 'interrupted: drives stopped, nodes ended' in text and 'Traceback' not in text
    assert [pid for pid in nodes if Path(f'/proc/{pid}').exists()] == []


def test_a_killed_demo_takes_its_nodes_with_it(start_process, tmp_path):
    process = start_process(DEMO, '--duration', '60', '--output', str(tmp_path / 'report'))
    wait_until(lambda: ' 0.0 s ' in process.log.read_text(), 'the first line', RUN_DEADLINE)
    nodes = children(process.pid)
    assert len(nodes) == 3
    os.kill(process.pid, signal.SIGKILL)
    wait_until(lambda: not any(Path(f'/proc/{pid}').exists() for pid in nodes), 'the nodes to end')


@pytest.mark.parametrize('arguments, sentence', [
    (('--duration', '0'), '0 s is not between 1 s and 86400 s'),
    (('--duration', 'nan'), 'nan s is not between'),
    (('--output', '/proc/nowhere'), '/proc/nowhere cannot be written'),
])
def test_bad_arguments_are_one_sentence_and_exit_status_2(start_process, arguments, sentence):
    process = start_process(DEMO, *arguments)
    wait_until(lambda: ended(process), 'the end of the demo')
    assert process.returncode == 2
    assert sentence in process.log.read_text()
    assert 'Traceback' not in process.log.read_text()
