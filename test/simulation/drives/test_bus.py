"""Simulated drives on a python-can bus, in a thread and in a separate process."""

from pathlib import Path
import subprocess
import sys
import threading
import time

import can
import pytest
from support import wait_until

from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.errors import BusError
from facade_manipulator.simulation.drives import __main__ as drive_simulator
from facade_manipulator.simulation.drives.drive import simulated_drives
from facade_manipulator.simulation.drives.simulator import DriveSimulator

pytestmark = pytest.mark.realtime

SOURCE = Path(__file__).resolve().parents[3]


def open_bus():
    return can.Bus(interface='virtual', channel='simulated drives', ignore_config=True)


def wait_for(bus, cob_id):
    def is_received():
        got = bus.recv(0.01)
        return got is not None and got.arbitration_id == cob_id
    wait_until(is_received, f'a frame {cob_id:03X}')


@pytest.fixture
def simulator():
    with DriveSimulator(open_bus(), simulated_drives(DEFAULT_AXES)) as made:
        yield made


@pytest.fixture
def listener(simulator):
    with open_bus() as made:
        yield made


def test_stopped_simulator_has_no_thread(simulator):
    simulator.stop()
    assert not any(thread.name == 'drive simulator' for thread in threading.enumerate())


def test_drives_answer_again_after_a_bus_failure(simulator, listener, monkeypatch):
    failures = []

    def fail(timeout):
        failures.append(time.monotonic())
        raise BusError('Network is down')

    with monkeypatch.context() as patch:
        patch.setattr(simulator._bus, 'receive', fail)
        wait_until(lambda: len(failures) > 3, 'failures')
    assert failures[3] - failures[0] > 0.1  # the thread does not use a whole core
    listener.send(can.Message(
        arbitration_id=0x601, data=bytes.fromhex('4000100000000000'), is_extended_id=False))
    wait_for(listener, 0x581)


# --- the executable

MODULE = 'facade_manipulator.simulation.drives'


def test_executable_imports_no_ros():
    code = (f'import sys, {MODULE}; '
            'assert not [m for m in sys.modules if m.startswith(("rcl", "numpy"))]')
    subprocess.run([sys.executable, '-c', code], check=True, cwd=SOURCE)


@pytest.mark.parametrize('arguments, words', [
    (['--interface', 'socketcan', '--channel', 'nosuchcan0'], 'nosuchcan0'),
    (['--interface', 'carrier_pigeon'], 'carrier_pigeon'),
    (['--interface', 'virtual', '--profile', 'nothing'], 'drive profile nothing'),
    (['--interface', 'virtual', '--node-ids', '1', '2', '200'], 'node_id = 200'),
    (['--interface', 'virtual', '--leads', '0'], 'lead = 0 m'),
    (['--interface', 'virtual', '--lag', 'nan'], 'lag'),
])
def test_wrong_option_is_rejected_in_one_sentence(arguments, words, capsys):
    assert drive_simulator.main(arguments) == 1
    output = capsys.readouterr()
    assert words in output.err and output.err.count('\n') == 1 and output.out == ''


def test_options_of_the_executable_reach_the_drives():
    first, second = drive_simulator.make_drives(drive_simulator._parser().parse_args([
        '--node-ids', '4', '5', '--start-positions', '0.2', '--directions', '-1',
        '--lag', '0.02', '--missing-objects', '0x60C5']))
    assert [first.node_id, second.node_id] == [4, 5]
    for drive in (first, second):
        assert drive.objects.read((0x1018, 4)) == drive.node_id
        assert drive.motor.carriage_position == pytest.approx(0.2) and drive.motor.lag == 0.02
        assert (0x60C5, 0) not in drive.objects.variables
