"""
Launch one manipulator: driver, and compensator with ik_service in one process.

The driver configures itself at its start; only an operator's request powers the drives on. With
`use_mock_hardware` the drives and the gondola are simulated; `scenario` and `viewer` choose the
simulated world. Robot_state_publisher is started if it is installed. With `record` the topics are
recorded as record.launch.py describes.

The end of one node ends all nodes; launch then ends with status 1 unless the exit status of that
node was 0, or Ctrl-C ended it. In any order, the driver brings the carriages to rest, powers
off and closes the bus. The end of estimator, robot_state_publisher or recorder does not end any
other node.
"""

import json
from pathlib import Path
import signal

from ament_index_python.packages import get_packages_with_prefixes
from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    IncludeLaunchDescription,
    LogInfo,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.conditions import IfCondition
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.logging import launch_config
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from facade_manipulator import config_path, topics
from facade_manipulator.executables import INTERRUPTED
from facade_manipulator.kinematics import Geometry, urdf
from facade_manipulator.nodes.planar_messages import Frames
from facade_manipulator.package_files import machine_files
from facade_manipulator.parameters import ParameterSource, read_parameters
from facade_manipulator.simulation.world.scenario import (
    load_scenario,
    simulation_parameters,
)
from facade_manipulator.timeouts import DRIVER_TIMEOUT

PACKAGE = 'facade_manipulator'
RECORDING = Path(__file__).with_name('record.launch.py')
BOOLEAN = ['true', 'false', 'True', 'False']
# Ctrl-C may end a node before launch itself receives it, also while the node still starts.
ORDERLY_ENDS = (0, INTERRUPTED, -signal.SIGINT)
RESPAWN = {'respawn': True, 'respawn_delay': 2.0}  # s


def _is_true(context, argument: str) -> bool:
    return IfCondition(LaunchConfiguration(argument)).evaluate(context)


def _is_mock(context) -> bool:
    return _is_true(context, 'use_mock_hardware')


def _namespace(context) -> str:
    return LaunchConfiguration('namespace').perform(context).strip('/')


def _parameter_files(context) -> list[str]:
    """Return the parameter files; later files override earlier files."""
    config = LaunchConfiguration('config').perform(context)
    if not Path(config).is_file():  # launch itself would use the defaults
        raise RuntimeError(
            f'config rejected: {config} is not a file; next: check the path'
        )
    files = [str(file) for file in machine_files([Path(config)])]
    return [*files, str(config_path('simulation.yaml'))] if _is_mock(context) else files


def _simulation_file(context, scenario: str) -> list[str]:
    """Return the parameter file of `scenario` and `viewer`, or no file if neither is set."""
    viewer = _is_true(context, 'viewer')
    given = [f'scenario:={scenario}'] if scenario else []
    if viewer:
        given.append('viewer:=true')
    if not given:
        return []

    if not _is_mock(context):
        raise RuntimeError(
            f'{given[0]} rejected: only the simulated gondola uses it, and use_mock_hardware is '
            f'false; next: add use_mock_hardware:=true, or remove {" and ".join(given)}'
        )

    content = simulation_parameters(scenario, viewer=viewer)
    file = Path(launch_config.log_dir, 'simulation.yaml')  # a folder of this launch
    file.write_text(json.dumps(content))
    return [str(file)]


def _needs_estimator(context, scenario: str) -> bool:
    """Return whether the disturbance must be estimated from raw sensors."""
    if _is_true(context, 'estimator'):
        return True
    return bool(scenario) and load_scenario(scenario).raw_sensors


def _common(context, name: str) -> dict:
    """Return the arguments that the nodes share; config/sros2_policy.xml defines the enclave."""
    namespace = _namespace(context)
    enclave = '/'.join(('', *filter(None, (namespace, name))))
    level = LaunchConfiguration('log_level').perform(context)
    return {
        'namespace': namespace,
        'ros_arguments': ['--log-level', level, '--enclave', enclave],
        'output': 'screen',
    }


def _manipulator(context) -> list:
    """Return the package's nodes; `can_interface` overrides the driver's parameter files."""
    scenario = LaunchConfiguration('scenario').perform(context)
    files = [*_parameter_files(context), *_simulation_file(context, scenario)]
    channel = LaunchConfiguration('can_interface').perform(context)
    # A transition requested by launch would race with Ctrl-C: launch_ros uses its node while it
    # destroys the node.
    override = {'configure_at_start': True}
    if channel and not _is_mock(context):
        override['bus.channel'] = channel
    driver = Node(
        package=PACKAGE,
        executable='driver',
        name='driver',
        sigterm_timeout=str(DRIVER_TIMEOUT),
        parameters=[*files, override],
        **_common(context, 'driver'),
    )
    others = (
        ['manipulator', 'gondola_simulator'] if _is_mock(context) else ['manipulator']
    )
    nodes = [
        driver,
        *(
            Node(
                package=PACKAGE,
                executable=name,
                parameters=files,
                **_common(context, name),
            )
            for name in others
        ),
    ]
    events = [_end_with(node) for node in nodes]
    if not _needs_estimator(context, scenario):
        return [*events, *nodes]

    estimator = Node(  # without the estimator the correction fades out
        package=PACKAGE,
        executable='disturbance_estimator',
        name='disturbance_estimator',
        parameters=files,
        **RESPAWN,
        **_common(context, 'disturbance_estimator'),
    )
    return [*events, *nodes, estimator]


def _end_with(node: Node) -> RegisterEventHandler:
    """End all nodes when this node ends; the driver then stops its drives."""

    def shut_down(event, context):
        if context.is_shutdown:
            return []
        reason = f'{event.process_name} ended with exit status {event.returncode}'
        if event.returncode not in ORDERLY_ENDS:
            raise RuntimeError(reason)  # ends all nodes, and launch with exit status 1
        return [EmitEvent(event=Shutdown(reason=reason))]

    return RegisterEventHandler(OnProcessExit(target_action=node, on_exit=shut_down))


def _robot_state_publisher(context) -> list:
    """Return the node that publishes the transforms of the links, if it is installed."""
    name = 'robot_state_publisher'
    if name not in get_packages_with_prefixes():
        return [
            LogInfo(
                msg=f'no transforms of the links: {name} is not installed; '
                'next: sudo apt install ros-jazzy-robot-state-publisher'
            )
        ]
    files = [Path(file) for file in _parameter_files(context)]
    source = ParameterSource(read_parameters(files, 'ik_service'))
    geometry = source.read(Geometry, 'geometry')
    prefix = Frames.of(_namespace(context)).prefix
    description = ParameterValue(urdf(geometry, prefix), value_type=str)
    return [
        Node(
            package=name,
            executable=name,
            name=name,
            **RESPAWN,
            **_common(context, name),
            # ik_service already limits the rate to 20 Hz
            parameters=[{'robot_description': description, 'publish_frequency': 100.0}],
            remappings=[
                ('joint_states', topics.MECHANISM_STATES.name),
                # ik_service publishes the same description
                ('robot_description', f'{name}/robot_description'),
            ],
        )
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the description of the manipulator's nodes and arguments."""
    arguments = (
        ('use_mock_hardware', 'false', 'simulate the drives and the gondola', BOOLEAN),
        (
            'scenario',
            '',
            'scenario of the simulated gondola: a name in config/scenarios, or a file; empty '
            "takes the parameter file's",
            None,
        ),
        ('viewer', 'false', "show the simulated gondola in MuJoCo's viewer", BOOLEAN),
        (
            'estimator',
            'false',
            'estimate the disturbance from raw sensors on the rail',
            BOOLEAN,
        ),
        ('record', 'false', 'record the topics with ros2 bag', BOOLEAN),
        ('namespace', '', 'namespace of the nodes, one per gondola', None),
        (
            'config',
            str(config_path('manipulator.yaml')),
            'parameter file; a machine.yaml beside it is loaded after it',
            None,
        ),
        (
            'can_interface',
            '',
            "CAN interface of the drives; empty takes the parameter file's",
            None,
        ),
        (
            'log_level',
            'info',
            'minimum severity that is logged',
            ['debug', 'info', 'warn', 'error'],
        ),
    )
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(
                    name, default_value=value, description=text, choices=choices
                )
                for name, value, text, choices in arguments
            ),
            OpaqueFunction(function=_manipulator),
            OpaqueFunction(function=_robot_state_publisher),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(str(RECORDING)),
                launch_arguments=[
                    ('namespace', LaunchConfiguration('namespace')),
                    ('required', 'false'),  # the machine also works without a recorder
                ],
                condition=IfCondition(LaunchConfiguration('record')),
            ),
        ]
    )
