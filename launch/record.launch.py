"""
Record the topics of one manipulator with `ros2 bag record` as MCAP files.

The bags are in the folder `folder`; the default is ~/.ros/facade_manipulator and, below it, the
namespace. If ros2bag or its MCAP storage is not installed, launch ends with exit status 1 and the
missing package. With `required:=false`, as in manipulator.launch.py, only a log line reports the
package, and no bag is recorded. The options are those of rosbag2 0.26.5 (Jazzy).
"""

import os
from pathlib import Path

from ament_index_python.packages import get_packages_with_prefixes
from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    ExecuteProcess,
    LogInfo,
    OpaqueFunction,
)
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
import yaml

from facade_manipulator import config_path, topics

PACKAGE = 'facade_manipulator'
PROGRAMS = ('ros2bag', 'rosbag2_storage_mcap')
FILE_DURATION = (
    '600'  # s: a power cut costs the index of one file, old files can be deleted
)
RESPAWN_DELAY = 2.0  # s
TOPICS = (
    *(topic.name for topic in vars(topics).values() if isinstance(topic, topics.Topic)),
    'driver/transition_event',
    '/rosout',
    '/parameter_events',
    '/tf',
    '/tf_static',
)  # of robot_state_publisher, for playing the bag into a viewer


def _absolute(namespace: str, name: str) -> str:
    """Return the full name of a topic or an enclave in the namespace."""
    return (
        name
        if name.startswith('/')
        else '/'.join(('', *filter(None, (namespace, name))))
    )


def _qos_overrides(namespace: str, folder: Path) -> Path:
    """Write the QoS overrides with the names of the topics in the namespace."""
    names = {_absolute('', name): name for name in TOPICS}
    overrides = yaml.safe_load(config_path('recording_qos.yaml').read_text())
    path = folder / 'recording_qos.yaml'
    path.write_text(
        yaml.safe_dump(
            {
                _absolute(namespace, names[name]): profile
                for name, profile in overrides.items()
            }
        )
    )
    return path


def _recorder(context) -> list:
    missing = [name for name in PROGRAMS if name not in get_packages_with_prefixes()]
    if missing:
        packages = ' '.join(f'ros-jazzy-{name.replace("_", "-")}' for name in missing)
        message = (
            f'no topic is recorded: {" and ".join(missing)} not installed; '
            f'next: sudo apt install {packages}'
        )
        if IfCondition(LaunchConfiguration('required')).evaluate(context):
            raise RuntimeError(message)
        return [LogInfo(msg=message)]
    namespace = LaunchConfiguration('namespace').perform(context).strip('/')
    given = LaunchConfiguration('folder').perform(context)
    home = Path(os.environ.get('ROS_HOME', '~/.ros')).expanduser()
    folder = Path(given) if given else home / PACKAGE / namespace
    folder.mkdir(parents=True, exist_ok=True)
    node_name = '_'.join(('recorder', *filter(None, namespace.split('/'))))
    return [
        ExecuteProcess(
            cmd=[
                'ros2',
                'bag',
                'record',
                '--storage',
                'mcap',
                '--max-bag-duration',
                FILE_DURATION,
                '--qos-profile-overrides-path',
                str(_qos_overrides(namespace, folder)),
                '--node-name',
                node_name,
                '--disable-keyboard-controls',
                '--topics',
                *(_absolute(namespace, name) for name in TOPICS),
            ],
            cwd=str(folder),  # each start makes a folder in it, named by the time
            additional_env={
                'ROS_SECURITY_ENCLAVE_OVERRIDE': _absolute(namespace, 'recorder')
            },
            output='screen',
            respawn=True,
            respawn_delay=RESPAWN_DELAY,
        )
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the description of the recorder and its arguments."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'namespace',
                default_value='',
                description='namespace of the recorded nodes',
            ),
            DeclareLaunchArgument(
                'folder',
                default_value='',
                description='folder of the bags; default: below ~/.ros',
            ),
            DeclareLaunchArgument(
                'required',
                default_value='true',
                description='whether a missing package ends launch',
                choices=['true', 'false'],
            ),
            OpaqueFunction(function=_recorder),
        ]
    )
