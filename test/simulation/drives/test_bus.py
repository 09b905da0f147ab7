"""Simulated drives on a python-can bus, and options of their executable."""

import os
import signal
import subprocess
import threading
import time

import can
import pytest
from support import wait_until

from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.simulation.drives import __main__ as drive_simulator
from facade_manipulator.simulation.drives.drive import SimulatedDrive
from facade_manipulator.simulation.drives.simulator import DriveSimulator


def test_stopped_simulator_has_no_thread():
    bus = can.Bus(interface='virtual', channel='simulated drives', ignore_config=True)
    DriveSimulator(bus, [*map(SimulatedDrive, DEFAULT_AXES)]).stop()
    assert not any(thread.name == 'drive simulator' for thread in threading.enumerate())


@pytest.mark.parametrize(
    'arguments, words',
    [
        (['--interface', 'socketcan', '--channel', 'nosuchcan0'], 'nosuchcan0'),
        (['--interface', 'carrier_pigeon'], 'carrier_pigeon'),
        (['--interface', 'virtual', '--profile', 'nothing'], 'drive profile nothing'),
        (['--interface', 'virtual', '--node-ids', '1', '2', '200'], 'node_id = 200'),
        (['--interface', 'virtual', '--leads', '0'], 'lead = 0 m'),
        (['--interface', 'virtual', '--lag', 'nan'], 'lag'),
    ],
)
def test_wrong_option_is_rejected_in_one_sentence(arguments, words, capsys):
    assert drive_simulator.main(arguments) == 1
    output = capsys.readouterr()
    assert words in output.err
    assert output.err.count('\n') == 1
    assert output.out == ''


def test_options_of_the_executable_reach_the_drives():
    options = (
        '--node-ids 4 5 --start-positions 0.2 --directions -1 --lag 0.02 '
        '--missing-objects 0x60C5'
    )
    arguments = drive_simulator._parser().parse_args(options.split())
    first, second = drive_simulator.make_drives(arguments)
    assert first.node_id == 4
    assert second.node_id == 5
    for drive in (first, second):
        assert drive.objects.read((0x1018, 4)) == drive.node_id
        assert drive.motor.carriage_position == pytest.approx(0.2)
        assert drive.motor.lag == 0.02
        assert (0x60C5, 0) not in drive.objects.variables


def test_drive_simulator_continues_after_a_stopped_process(start_process):
    """Ctrl-Z and fg in its terminal."""
    process = start_process(
        'facade_manipulator.simulation.drives',
        '--interface',
        'virtual',
        stdin=subprocess.PIPE,
    )
    wait_until(lambda: 'ruler' in process.log.read_text(), 'the start')
    os.kill(process.pid, signal.SIGSTOP)
    time.sleep(0.3)  # s, longer than the process waits for a signal
    os.kill(process.pid, signal.SIGCONT)
    process.stdin.write(b'ruler\n')
    process.stdin.flush()
    wait_until(lambda: 'middle of the rail' in process.log.read_text(), 'the reply')
    assert process.poll() is None
