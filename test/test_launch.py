"""Launch/manipulator.launch.py with the installed launch and launch_ros."""

from contextlib import suppress
import os
from pathlib import Path
import re
import signal
import sys
import time

from ament_index_python.packages import get_packages_with_prefixes
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
import pytest
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
from support import DEADLINE, wait_until
import yaml

from facade_manipulator import config_path, topics
from facade_manipulator.client import ManipulatorClient
from facade_manipulator.executables import INTERRUPTED
from facade_manipulator.kinematics import Geometry, urdf

pytest.importorskip(
    'launch_ros',
    reason='launch_ros is not installed; next: make test LAUNCH_SOURCES=FOLDER, '
    'with clones of launch and launch_ros in FOLDER',
)

PACKAGE = 'facade_manipulator'
NODES = ('driver', 'manipulator', 'gondola_simulator')
ESTIMATOR = 'disturbance_estimator'
LINK_TRANSFORMS = 'robot_state_publisher'
EXECUTABLES = {*NODES, LINK_TRANSFORMS}
OPTIONAL = (LINK_TRANSFORMS, 'ros2bag', 'rosbag2_storage_mcap')
# a program of another package, which waits for SIGINT or SIGTERM
STAND_IN = """
import signal
import sys
for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, lambda *_: sys.exit())
signal.pause()
"""
LAUNCHER = """
import sys
from launch import LaunchService
from launch.actions import IncludeLaunchDescription
service = LaunchService()
service.include_launch_description(IncludeLaunchDescription(
    sys.argv[1], launch_arguments=[argument.split(':=', 1) for argument in sys.argv[2:]]))
sys.exit(service.run())
"""


class Launch:
    """Launch files started from an ament prefix with the package's and others' executables."""

    def __init__(self, start_process, folder: Path) -> None:
        self._start_process = start_process
        self._executables = folder / 'lib' / PACKAGE
        #: index of ament, whose files are the names of the installed packages
        self.packages = folder / 'share' / 'ament_index' / 'resource_index' / 'packages'
        self.packages.mkdir(parents=True)
        for name in (PACKAGE, *OPTIONAL):
            (self.packages / name).touch()
        scripts = {
            f'lib/{PACKAGE}/{name}': (
                f'from {PACKAGE}.executables import {name}\n'
                f'raise SystemExit({name}())\n'
            )
            for name in (*NODES, ESTIMATOR)
        }
        others = (f'lib/{LINK_TRANSFORMS}/{LINK_TRANSFORMS}', 'bin/ros2')
        for name, code in {**scripts, **dict.fromkeys(others, STAND_IN)}.items():
            script = folder / name
            script.parent.mkdir(parents=True, exist_ok=True)
            script.write_text(f'#!{sys.executable}\n{code}')
            script.chmod(0o755)
        (folder.parent / 'launcher.py').write_text(LAUNCHER)
        self._environment = {
            name: os.pathsep.join(filter(None, (str(path), os.environ.get(name))))
            for name, path in (('AMENT_PREFIX_PATH', folder), ('PATH', folder / 'bin'))
        }

    def write(self, name: str, code: str) -> None:
        """Replace an executable of the package."""
        (self._executables / name).write_text(f'#!{sys.executable}\n{code}')

    def __call__(self, *arguments, name: str = 'manipulator'):
        """Start a launch file of the package."""
        return self._start_process(
            'launcher',
            str(config_path().parent / f'launch/{name}.launch.py'),
            *arguments,
            env=self._environment,
        )


@pytest.fixture
def launch(start_process, tmp_path):
    return Launch(start_process, tmp_path / 'prefix')


def pids_of(process) -> dict[str, int]:
    """Return the process ids of the executables that a launch has started."""
    return {
        name: int(pid)
        for name, pid in re.findall(
            r'\[(\w+)-\d+\]: process started with pid \[(\d+)\]',
            process.log.read_text(),
        )
    }


def command(pid: int) -> list[str]:
    """Return the words of a process's command line, empty after its end."""
    with suppress(FileNotFoundError, ProcessLookupError):
        return Path(f'/proc/{pid}/cmdline').read_text().split('\0')[:-1]
    return []


def until_started(process, name: str) -> tuple[int, list[str]]:
    """Return process id and arguments of an executable after its start."""
    pid = wait_until(
        lambda: pids_of(process).get(name), f'the start of {name}', 2 * DEADLINE
    )
    # while the kernel executes the program, its command line is empty
    words = wait_until(lambda: command(pid)[2:], f'the arguments of {name}')
    return pid, words


def until_logged(process, text: str) -> None:
    wait_until(lambda: text in process.log.read_text(), text, 2 * DEADLINE)


def test_mock_hardware_is_configured_and_ends_in_order(launch, ros):
    process = launch('use_mock_hardware:=true', 'namespace:=gondola_1')
    until_logged(process, 'are configured')
    operator = ros.node('operator')
    state = ros.call(operator, GetState, 'gondola_1/driver/get_state').current_state.id
    # no other program powers the drives on
    assert state == State.PRIMARY_STATE_INACTIVE
    ros.until(
        lambda: {'ik_service', 'gondola_simulator'} <= {*operator.get_node_names()},
        'the other nodes',
    )
    # Ctrl-C reaches the children by the terminal, not by launch
    os.killpg(process.pid, signal.SIGINT)
    assert process.wait(DEADLINE) == 0
    log = process.log.read_text()
    assert log.count('process has finished cleanly') == len(EXECUTABLES)


@pytest.mark.parametrize('delay', [0.0, 0.8, 1.6, 2.4, 3.2])
def test_ctrl_c_before_the_configuration_ends_in_order(launch, delay):
    process = launch('use_mock_hardware:=true')
    # launch 3.4.3 loses a process that Ctrl-C ends while launch creates this process
    wait_until(
        lambda: pids_of(process).keys() == EXECUTABLES,
        'the start of all processes',
        DEADLINE,
    )
    time.sleep(delay)  # s: another moment of the start
    os.killpg(process.pid, signal.SIGINT)
    assert process.wait(DEADLINE) == 0
    assert not any(map(command, pids_of(process).values()))
    assert '[launch]: Caught exception' not in process.log.read_text()


def test_node_interrupted_before_launch_ends_launch_in_order(launch):
    launch.write('manipulator', f'raise SystemExit({INTERRUPTED})')  # as in its import
    process = launch('use_mock_hardware:=true')
    assert process.wait(DEADLINE) == 0
    assert '[launch]: Caught exception' not in process.log.read_text()


def test_launch_itself_joins_no_ros_graph(launch, ros):
    launch('use_mock_hardware:=true')
    operator = ros.node('operator')
    expected = {'driver', 'compensator', 'ik_service', 'gondola_simulator', 'operator'}
    ros.until(lambda: expected <= {*operator.get_node_names()}, 'the nodes')
    assert {*operator.get_node_names()} == expected


def values_of(ros, node, *names):
    """Return the values of a running node's parameters."""
    request = GetParameters.Request(names=names)
    reply = ros.call(
        ros.node('reader'), GetParameters, f'{node}/get_parameters', request
    )
    return [parameter_value_to_python(value) for value in reply.values]


def test_scenario_sets_simulator_and_contact(launch, ros):
    process = launch('use_mock_hardware:=true', 'scenario:=pressing')
    until_logged(process, 'are configured')
    assert values_of(ros, 'gondola_simulator', 'scenario') == ['pressing']
    contact = values_of(ros, 'compensator', 'contact.enabled', 'contact.force')
    assert contact == [True, 30.0]
    assert ESTIMATOR not in pids_of(process)


def test_scenario_with_raw_sensors_starts_the_estimator(launch):
    process = launch('use_mock_hardware:=true', 'scenario:=sensors')
    until_started(process, ESTIMATOR)


def test_viewer_without_display_is_rejected_with_the_reason(launch, monkeypatch):
    for name in ('DISPLAY', 'WAYLAND_DISPLAY'):
        monkeypatch.delenv(name, raising=False)
    process = launch('use_mock_hardware:=true', 'viewer:=true')
    assert process.wait(DEADLINE) == 1
    assert 'viewer rejected: this computer has no display' in process.log.read_text()


@pytest.mark.parametrize('victim', ['manipulator', 'driver'])
def test_death_of_one_node_ends_all_nodes(launch, ros, victim):
    process = launch('use_mock_hardware:=true', 'namespace:=gondola_1')
    until_logged(process, 'are configured')
    with ManipulatorClient('gondola_1') as client:
        client.home()
        client.activate()
    pids = pids_of(process)
    assert pids.keys() == EXECUTABLES
    os.kill(pids[victim], signal.SIGKILL)
    assert process.wait(DEADLINE) == 1
    assert not any(map(command, pids.values()))
    log = process.log.read_text()
    assert f'{victim}-' in log
    assert 'exit code -9' in log
    if victim != 'driver':
        assert re.search(r'\[driver-\d+\]: process has finished cleanly', log)


def test_robot_state_publisher_gets_urdf_of_parameter_files(launch, tmp_path):
    config = tmp_path / 'own.yaml'
    # the latter file has priority
    for path, length in ((config, 0.35), (tmp_path / 'machine.yaml', 0.36)):
        path.write_text(
            f'/**: {{ros__parameters: {{geometry: {{link_length: {length}}}}}}}'
        )
    process = launch(
        f'config:={config}', 'namespace:=gondola_1', 'can_interface:=can77'
    )
    _, arguments = until_started(process, LINK_TRANSFORMS)
    parameters = {}
    for path in filter(os.path.isfile, arguments):
        for section in yaml.safe_load(Path(path).read_text()).values():
            parameters |= section['ros__parameters']
    assert parameters['robot_description'] == urdf(
        Geometry(link_length=0.36), 'gondola_1/'
    )
    assert {
        'joint_states:=ik_service/joint_states',
        '__ns:=/gondola_1',
        'robot_description:=robot_state_publisher/robot_description',
    } <= {*arguments}


@pytest.mark.parametrize(
    'name, arguments',
    [('manipulator', ('record:=true', 'can_interface:=can77')), ('record', ())],
)
def test_ros2_bag_records_each_topic(launch, name, arguments):
    pid, options = until_started(
        launch('namespace:=gondola_1', *arguments, name=name), 'ros2'
    )
    names = {
        '/tf',
        '/tf_static',
        '/rosout',
        '/parameter_events',
        '/gondola_1/driver/transition_event',
    }
    for one in vars(topics).values():
        if isinstance(one, topics.Topic):
            names.add(
                one.name if one.name.startswith('/') else f'/gondola_1/{one.name}'
            )
    cut = options.index('--topics')
    assert options[:6] == [
        'bag',
        'record',
        '--storage',
        'mcap',
        '--max-bag-duration',
        '600',
    ]
    assert set(options[cut + 1 :]) == names
    assert Path(f'/proc/{pid}/cwd').readlink().parts[-2:] == (PACKAGE, 'gondola_1')
    file = options[options.index('--qos-profile-overrides-path') + 1]
    overrides = yaml.safe_load(Path(file).read_text())
    assert overrides['/gondola_1/joint_states']['reliability'] == 'best_effort'
    assert '/tf' in overrides
    assert overrides.keys() <= names


@pytest.mark.parametrize('package', OPTIONAL)
def test_missing_optional_package_is_reported_while_nodes_start(launch, package):
    if package in get_packages_with_prefixes():
        pytest.skip(f'{package} is installed')
    (launch.packages / package).unlink()
    process = launch('record:=true', 'can_interface:=can77')
    until_logged(
        process, f'next: sudo apt install ros-jazzy-{package.replace("_", "-")}'
    )
    until_logged(process, 'process started with pid')


@pytest.mark.parametrize('package', OPTIONAL[1:])
def test_recorder_without_its_package_ends_with_status_1(launch, package):
    if package in get_packages_with_prefixes():
        pytest.skip(f'{package} is installed')
    (launch.packages / package).unlink()
    process = launch(name='record')
    assert process.wait(DEADLINE) == 1
    next_step = f'next: sudo apt install ros-jazzy-{package.replace("_", "-")}'
    assert next_step in process.log.read_text()


@pytest.mark.parametrize(
    'arguments, message',
    [
        ('config:=nowhere.yaml', 'config rejected: nowhere.yaml is not a file'),
        ('log_level:=loud', "'debug', 'info', 'warn', 'error'"),
        ('use_mock_hardware:=perhaps', "'true', 'false'"),
        (
            'scenario:=pressing',
            'scenario:=pressing rejected: only the simulated gondola',
        ),
        ('viewer:=true', 'viewer:=true rejected: only the simulated gondola'),
        ('use_mock_hardware:=true scenario:=gale', 'scenario gale rejected'),
    ],
)
def test_wrong_launch_argument_is_reported_and_starts_nothing(
    launch, arguments, message
):
    process = launch(*arguments.split())
    assert process.wait(DEADLINE) != 0
    log = process.log.read_text()
    assert message in log
    assert 'process started' not in log


def test_driver_without_can_interface_stays_unconfigured(launch, ros):
    process = launch('can_interface:=can77', 'log_level:=warn')
    until_logged(process, 'can77')
    assert 'ros2' not in process.log.read_text()  # no bag is recorded
    state = ros.call(
        ros.node('operator'), GetState, 'driver/get_state'
    ).current_state.id
    assert state == State.PRIMARY_STATE_UNCONFIGURED
    os.killpg(process.pid, signal.SIGINT)
    process.wait(DEADLINE)
