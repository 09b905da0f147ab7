"""launch/manipulator.launch.py with the real launch and launch_ros, where they are installed."""

from __future__ import annotations

import json
import os
from pathlib import Path
import re
import signal
import sys

from ament_index_python.packages import get_packages_with_prefixes
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
import pytest
from support import DEADLINE, wait_until
import yaml

from facade_manipulator import config_path, topics
from facade_manipulator.client import ManipulatorClient
from facade_manipulator.kinematics import Geometry, urdf

pytest.importorskip('launch_ros', reason='launch_ros is not installed; apt Jazzy has it')

PACKAGE = 'facade_manipulator'
NODES = ('driver', 'manipulator', 'gondola_simulator')
LINK_TRANSFORMS = 'robot_state_publisher'
EXECUTABLES = (*NODES, LINK_TRANSFORMS)
OPTIONAL = (LINK_TRANSFORMS, 'ros2bag', 'rosbag2_storage_mcap')
# a program of another package: writes its arguments and files, waits for SIGINT or SIGTERM
STAND_IN = """
import json
from pathlib import Path
import signal
import sys

arguments = sys.argv[1:]
started = {'arguments': arguments, 'folder': str(Path.cwd()), 'files': {
    path: Path(path).read_text() for path in arguments if Path(path).is_file()}}
draft = Path(__file__).with_suffix('.draft')
draft.write_text(json.dumps(started))
draft.rename(Path(__file__).with_suffix('.json'))
signal.signal(signal.SIGTERM, lambda *_: sys.exit())
try:
    signal.pause()
except KeyboardInterrupt:
    pass
"""
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


class Launch:
    """Launch files started from an ament prefix with the package's and others' executables."""

    def __init__(self, start_process, folder: Path) -> None:
        self._start_process = start_process
        self._packages = folder / 'share' / 'ament_index' / 'resource_index' / 'packages'
        self._packages.mkdir(parents=True)
        for name in (PACKAGE, *OPTIONAL):
            (self._packages / name).touch()
        for name in NODES:
            code = f'from {PACKAGE}.nodes.{name} import main\nraise SystemExit(main())\n'
            self._write_script(folder / 'lib' / PACKAGE / name, code)
        self._stand_ins = {
            LINK_TRANSFORMS: folder / 'lib' / LINK_TRANSFORMS / LINK_TRANSFORMS,
            'ros2': folder / 'bin' / 'ros2'}
        for script in self._stand_ins.values():
            self._write_script(script, STAND_IN)
        (folder.parent / 'launcher.py').write_text(LAUNCHER)
        self._environment = {
            name: os.pathsep.join(filter(None, (str(path), os.environ.get(name))))
            for name, path in (('AMENT_PREFIX_PATH', folder), ('PATH', folder / 'bin'))}

    @staticmethod
    def _write_script(path: Path, code: str) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'#!{sys.executable}\n{code}')
        path.chmod(0o755)

    def __call__(self, *arguments, name: str = 'manipulator'):
        """Launch a launch file of the package."""
        return self._start_process(
            'launcher', str(config_path().parent / f'launch/{name}.launch.py'), *arguments,
            env=self._environment)

    def remove(self, package: str) -> None:
        """Take a package out of the ament index."""
        (self._packages / package).unlink()

    def started(self, name: str) -> dict:
        """Return the arguments and files with which a program of another package was started."""
        file = self._stand_ins[name].with_suffix('.json')
        wait_until(file.is_file, f'the start of {name}', 2 * DEADLINE)
        return json.loads(file.read_text())


@pytest.fixture
def launch(start_process, tmp_path):
    return Launch(start_process, tmp_path / 'prefix')


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


def test_mock_hardware_is_configured_and_ends_in_order(launch, ros):
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
def test_death_of_one_node_ends_all_nodes(launch, ros, victim):
    process = launch('use_mock_hardware:=true', 'namespace:=gondola_1')
    until_logged(process, 'are configured')
    with ManipulatorClient('gondola_1') as client:
        client.home()
        client.activate()
    pids = {name: int(pid) for name, pid in re.findall(
        r'\[(\w+)-\d+\]: process started with pid \[(\d+)\]', process.log.read_text())}
    assert pids.keys() == {*EXECUTABLES}
    os.kill(pids[victim], signal.SIGKILL)
    assert process.wait(DEADLINE) == 1
    assert not any(map(is_alive, pids.values()))
    log = process.log.read_text()
    assert f'{victim}-' in log and 'exit code -9' in log
    if victim != 'driver':
        assert re.search(r'\[driver-\d+\]: process has finished cleanly', log)


def test_robot_state_publisher_gets_urdf_of_parameter_files(launch, tmp_path):
    config = tmp_path / 'own.yaml'
    for path, length in ((config, 0.35), (tmp_path / 'machine.yaml', 0.36)):  # the latter wins
        path.write_text(f'/**: {{ros__parameters: {{geometry: {{link_length: {length}}}}}}}')
    launch(f'config:={config}', 'namespace:=gondola_1', 'can_interface:=can77')
    started = launch.started(LINK_TRANSFORMS)
    parameters = {}
    for text in started['files'].values():
        for section in yaml.safe_load(text).values():
            parameters |= section['ros__parameters']
    assert parameters['robot_description'] == urdf(Geometry(link_length=0.36), 'gondola_1/')
    assert {'joint_states:=ik_service/joint_states', '__ns:=/gondola_1',
            'robot_description:=robot_state_publisher/robot_description'} <= {
                *started['arguments']}


@pytest.mark.parametrize('name, arguments', [
    ('manipulator', ('record:=true', 'can_interface:=can77')), ('record', ())])
def test_ros2_bag_records_each_topic(launch, name, arguments):
    launch('namespace:=gondola_1', *arguments, name=name)
    started = launch.started('ros2')
    options = started['arguments']
    names = {'/tf', '/tf_static', '/rosout', '/parameter_events',
             '/gondola_1/driver/transition_event'}
    for one in vars(topics).values():
        if isinstance(one, topics.Topic):
            names.add(one.name if one.name.startswith('/') else f'/gondola_1/{one.name}')
    cut = options.index('--topics')
    assert options[:6] == [
        'bag', 'record', '--storage', 'mcap', '--max-bag-duration', '600']
    assert set(options[cut + 1:]) == names
    assert Path(started['folder']).parts[-2:] == (PACKAGE, 'gondola_1')
    file = options[options.index('--qos-profile-overrides-path') + 1]
    overrides = yaml.safe_load(started['files'][file])
    assert overrides['/gondola_1/joint_states']['reliability'] == 'best_effort'
    assert '/tf' in overrides and overrides.keys() <= names


@pytest.mark.parametrize('package, message', [
    (LINK_TRANSFORMS, 'next: sudo apt install ros-jazzy-robot-state-publisher'),
    ('ros2bag', 'next: sudo apt install ros-jazzy-ros2bag'),
    ('rosbag2_storage_mcap', 'next: sudo apt install ros-jazzy-rosbag2-storage-mcap'),
])
def test_missing_optional_package_is_reported_and_nodes_start(launch, package, message):
    if package in get_packages_with_prefixes():
        pytest.skip(f'{package} is installed')
    launch.remove(package)
    process = launch('record:=true', 'can_interface:=can77')
    until_logged(process, message)
    until_logged(process, 'process started with pid')


@pytest.mark.parametrize('argument, message', [
    ('config:=nowhere.yaml', 'config: nowhere.yaml is not a file'),
    ('log_level:=loud', "'debug', 'info', 'warn', 'error'"),
    ('use_mock_hardware:=perhaps', "'true', 'false'"),
])
def test_wrong_argument_starts_nothing_and_is_reported(launch, argument, message):
    process = launch(argument)
    assert process.wait(DEADLINE) != 0
    log = process.log.read_text()
    assert message in log and 'process started' not in log


def test_driver_without_can_interface_stays_unconfigured(launch, ros):
    process = launch('can_interface:=can77', 'log_level:=warn')
    until_logged(process, 'can77')
    assert 'ros2' not in process.log.read_text()  # nothing is recorded
    state = ros.call(ros.node('operator'), GetState, 'driver/get_state').current_state.id
    assert state == State.PRIMARY_STATE_UNCONFIGURED
    interrupt(process)
    process.wait(DEADLINE)
