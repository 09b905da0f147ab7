"""launch/manipulator.launch.py with the real launch and launch_ros, where they are installed."""

from __future__ import annotations

import os
from pathlib import Path
import re
import signal
import sys

from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
import pytest
from support import DEADLINE, wait_until

from facade_manipulator.resources import resource_path
from facade_manipulator.ros.client import ManipulatorClient

pytest.importorskip('launch_ros', reason='launch_ros is not installed; apt Jazzy has it')

PACKAGE = 'facade_manipulator'
EXECUTABLES = ('driver', 'manipulator', 'gondola_simulator', 'recorder')
LAUNCHER = """
import sys
from launch import LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

service = LaunchService()
service.include_launch_description(IncludeLaunchDescription(
    PythonLaunchDescriptionSource(sys.argv[1]),
    launch_arguments=[argument.split(':=', 1) for argument in sys.argv[2:]]))
sys.exit(service.run())
"""


@pytest.fixture
def launch(start_process, tmp_path):
    """Launch the package's launch file from an ament prefix with its executables."""
    prefix = tmp_path / 'prefix'
    marker = prefix / 'share' / 'ament_index' / 'resource_index' / 'packages' / PACKAGE
    marker.parent.mkdir(parents=True)
    marker.touch()
    folder = prefix / 'lib' / PACKAGE
    folder.mkdir(parents=True)
    for name in EXECUTABLES:
        script = folder / name
        script.write_text(f'#!{sys.executable}\nimport sys\n'
                          f'from {PACKAGE}.start import {name}\nsys.exit({name}())\n')
        script.chmod(0o755)
    (tmp_path / 'launcher.py').write_text(LAUNCHER)
    prefixes = [str(prefix), *filter(None, [os.environ.get('AMENT_PREFIX_PATH')])]

    def start(*arguments):
        return start_process(
            'launcher', str(resource_path('launch/manipulator.launch.py')), *arguments,
            env={'AMENT_PREFIX_PATH': os.pathsep.join(prefixes)})

    return start


def pid_of(process, name: str) -> int:
    found = re.search(rf'\[{name}-\d+\]: process started with pid \[(\d+)\]',
                      process.log.read_text())
    return int(found.group(1))


def is_alive(pid: int) -> bool:
    try:
        return Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()[0] != 'Z'
    except FileNotFoundError:
        return False


def interrupt(process) -> None:
    """Press Ctrl-C: launch leaves it to the terminal to tell the nodes as well."""
    os.killpg(process.pid, signal.SIGINT)


def until_logged(process, text: str) -> None:
    wait_until(lambda: text in process.log.read_text(), text, 2 * DEADLINE)


def test_launched_with_mock_hardware_the_driver_is_configured_and_ends_in_order(launch, ros):
    process = launch('use_mock_hardware:=true', 'namespace:=gondola_1')
    until_logged(process, 'are configured')
    operator = ros.node('operator')
    state = ros.call(operator, GetState, 'gondola_1/driver/get_state').current_state.id
    assert state == State.PRIMARY_STATE_INACTIVE  # nothing powers the drives on by itself
    ros.until(lambda: 'ik_service' in operator.get_node_names(), 'the ik_service')
    interrupt(process)
    assert process.wait(DEADLINE) == 0
    log = process.log.read_text()
    assert log.count('process has finished cleanly') == len(EXECUTABLES)


@pytest.mark.parametrize('victim', ['manipulator', 'driver'])
def test_the_death_of_one_node_ends_all_and_stops_the_drives(launch, ros, victim):
    process = launch('use_mock_hardware:=true', 'namespace:=gondola_1')
    until_logged(process, 'are configured')
    with ManipulatorClient('gondola_1') as client:
        client.home()
        client.activate()
    pids = {name: pid_of(process, name) for name in EXECUTABLES}
    os.kill(pids[victim], signal.SIGKILL)
    assert process.wait(DEADLINE) == 1
    assert not any(map(is_alive, pids.values()))
    log = process.log.read_text()
    assert f'{victim}-' in log and 'exit code -9' in log
    if victim != 'driver':
        assert re.search(r'\[driver-\d+\]: process has finished cleanly', log)


def test_launch_interrupted_alone_ends_its_nodes_in_the_end_and_terminated_alone_leaves_them(
        launch, ros):
    interrupted, terminated = (
        launch('use_mock_hardware:=true', f'namespace:=gondola_{k}') for k in (1, 2))
    for process in (interrupted, terminated):
        until_logged(process, 'are configured')
    pids = {process: [pid_of(process, name) for name in EXECUTABLES]
            for process in (interrupted, terminated)}
    interrupted.send_signal(signal.SIGINT)
    terminated.terminate()
    terminated.wait(DEADLINE)
    assert all(map(is_alive, pids[terminated]))
    interrupt(terminated)  # of its process group what is left
    wait_until(lambda: not any(map(is_alive, pids[terminated])), 'the end of the nodes left')
    interrupted.wait(2 * DEADLINE)
    log = interrupted.log.read_text()
    assert log.count('process has finished cleanly') == len(EXECUTABLES)
    assert "[driver-1]: process[driver-1] failed to terminate '15.0'" in log


@pytest.mark.parametrize('argument, message', [
    ('config:=nowhere.yaml', 'config: nowhere.yaml is not a file'),
    ('log_level:=loud', "'debug', 'info', 'warn', 'error'"),
    ('use_mock_hardware:=perhaps', "'true', 'false'"),
])
def test_a_wrong_argument_starts_nothing_and_says_so(launch, argument, message):
    process = launch(argument)
    assert process.wait(DEADLINE) != 0
    log = process.log.read_text()
    assert message in log and 'process started' not in log


def test_without_the_can_interface_the_driver_says_so_and_stays_unconfigured(launch, ros):
    process = launch('can_interface:=can77', 'log_level:=warn')
    until_logged(process, 'can77')
    state = ros.call(ros.node('operator'), GetState, 'driver/get_state').current_state.id
    assert state == State.PRIMARY_STATE_UNCONFIGURED
    interrupt(process)
    process.wait(DEADLINE)
