"""Executables on computers as they are: no home, no Unicode, no docstrings, a full disk."""

from __future__ import annotations

from io import BytesIO, TextIOWrapper
import os
from pathlib import Path
import re
import signal
import subprocess
import sys

import pytest
from support import wait_until

from facade_manipulator import start

NODES = ('driver', 'ik_service', 'compensator', 'manipulator', 'disturbance_estimator',
         'gondola_simulator')
SHOWN = {'drive_simulator': 'nodes 1, 2, 3', **dict.fromkeys(NODES, 'ready')}  # while they run
ARGUMENTS = {
    'calibrate': ['--help'], 'commission': ['--help'], 'demo': ['--help'],
    'drive_simulator': ['--interface', 'virtual'], 'stopping': [],
    'workspace_study': ['--table2'], **dict.fromkeys(NODES, [])}
PLAIN = {  # a terminal that knows ASCII alone, and an interpreter that has dropped docstrings
    'LC_ALL': 'C', 'PYTHONUTF8': '0', 'PYTHONCOERCECLOCALE': '0', 'PYTHONIOENCODING': 'ascii',
    'PYTHONOPTIMIZE': '2'}


def command(name):
    return [sys.executable, '-P', '-c',
            f'from facade_manipulator import start; raise SystemExit(start.{name}())',
            *ARGUMENTS[name]]


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.parametrize('name', ARGUMENTS)
def test_executable_runs_without_home_unicode_and_docstrings(name, ros_domain, tmp_path):
    environment = {key: value for key, value in os.environ.items() if key != 'HOME'} | PLAIN
    log = tmp_path / 'log'
    with log.open('wb') as output, subprocess.Popen(
            command(name), env=environment, cwd=tmp_path, stdout=output,
            stderr=output) as process:
        if name in SHOWN:
            wait_until(lambda: SHOWN[name] in log.read_text('ascii') or process.poll(),
                       f'{name} that runs', 60.0)
            process.send_signal(signal.SIGTERM)
        assert process.wait(60.0) == 0, log.read_text('ascii')
    assert 'Traceback' not in log.read_text('ascii') and log.stat().st_size


@pytest.mark.realtime
@pytest.mark.parametrize(('name', 'status'), [('demo', 130), ('driver', 0)])
def test_signal_during_imports_ends_the_process_at_once(name, status, tmp_path):
    with subprocess.Popen(command(name)[:-1] if name == 'demo' else command(name),
                          cwd=tmp_path, stderr=subprocess.PIPE) as process:
        caught = Path(f'/proc/{process.pid}/status')
        wait_until(lambda: int(re.search(r'SigCgt:\s*(\w+)', caught.read_text())[1], 16)
                   >> (signal.SIGTERM - 1) & 1, 'the handlers of signals')
        process.send_signal(signal.SIGINT)
        assert process.wait(5.0) == status
        assert process.stderr.read() == b''


@pytest.mark.long
def test_output_on_a_full_disk_ends_with_one_sentence():
    with open('/dev/full', 'wb') as full:
        done = subprocess.run(command('stopping'), stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 1
    assert done.stderr == 'stopping: No space left on device; next: free space on the disk\n'


@pytest.mark.parametrize('variables', [{'HOME': ''}, {'ROS_LOG_DIR': '/proc/log'}])
def test_missing_log_folder_names_the_remedy(variables):
    own = {name: text for name, text in os.environ.items()
           if name not in ('ROS_HOME', 'ROS_LOG_DIR')}
    done = subprocess.run(
        [sys.executable, '-c', 'from facade_manipulator.nodes.run import run; '
         'raise SystemExit(run(list, []))'],
        env=own | variables, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2
    assert 'could not start: ' in done.stderr and 'next: set ROS_LOG_DIR' in done.stderr


def test_character_that_the_terminal_lacks_is_escaped():
    raw = BytesIO()
    stream = start._writable(TextIOWrapper(raw, 'ascii'))
    print('3 × 2 mm', file=stream, flush=True)
    assert raw.getvalue() == b'3 \\xd7 2 mm\n'


def test_closed_output_is_replaced():
    with start._writable(None) as stream:
        assert stream.name == os.devnull
