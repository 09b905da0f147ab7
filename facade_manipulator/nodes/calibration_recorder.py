"""
The recorder for `calibrate estimator`: disturbance, carriages and the head on the wall as CSV.

It only listens, so it may run beside the machine at work; SIGINT ends the recording.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import csv
from pathlib import Path

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import (
    carriages_from,
    planar_pose,
    pose_numbers,
    projected,
    seconds,
)
from facade_manipulator.parameters import parameter, settings
from facade_manipulator.ros import declare, Rejections, run

COLUMNS = {'disturbance': ('x', 'y', 'theta'), 'joints': ('q1', 'q2', 'q3'),
           'wall': ('x', 'y', 'theta')}


@settings
class CalibrationRecorderSettings:
    """Where the recording goes."""

    folder: str = parameter('.', 'Folder of disturbance.csv, joints.csv and wall.csv')


class CalibrationRecorder(Node):
    """Write what comes on three topics, with its stamps."""

    def __init__(self, **kwargs) -> None:
        super().__init__('calibration_recorder', **kwargs)
        self._rejections = Rejections(self)
        folder = Path(declare(self, CalibrationRecorderSettings).folder)
        try:
            self._files = {
                name: (folder / f'{name}.csv').open(
                    'w', newline='', encoding='utf-8', buffering=1)  # line by line
                for name in COLUMNS}
        except OSError as error:
            raise ParameterError(f'folder = {folder} cannot be written: {error}') from error
        self._tables = {name: csv.writer(file) for name, file in self._files.items()}
        for name, columns in COLUMNS.items():
            self._tables[name].writerow(['time', *columns])
        for kind, topic, name, read in (
                (PoseWithCovarianceStamped, 'disturbance', 'disturbance', _disturbance),
                (Odometry, 'disturbance_odometry', 'disturbance', _disturbance),
                (JointState, 'joint_states', 'joints',
                 lambda message: carriages_from(message.name, message.position, 'joint_states')),
                (PoseStamped, 'head_on_wall', 'wall',
                 lambda message: planar_pose(message.pose, 'head_on_wall'))):
            self.create_subscription(
                kind, topic, self._writer(name, read), qos_profile_sensor_data)

    def _writer(
        self, name: str, read: Callable[[object], Sequence[float]]
    ) -> Callable[[object], None]:
        def write(message) -> None:
            with self._rejections:
                self._tables[name].writerow(
                    [f'{seconds(message.header.stamp):.6f}', *read(message)])

        return write

    def close(self) -> None:
        """End the recording."""
        for file in self._files.values():
            file.close()


def _disturbance(message: PoseWithCovarianceStamped | Odometry) -> Pose:
    return projected(pose_numbers(message.pose.pose), 'disturbance')[0]


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(lambda: [CalibrationRecorder()], args)


if __name__ == '__main__':
    raise SystemExit(main())
