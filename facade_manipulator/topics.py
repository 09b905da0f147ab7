"""
Topics and services of a manipulator, with type, name and quality of service.

Names are relative to the namespace of the node. The fields are in the order of rclpy:
``node.create_publisher(*GOAL_POSE)``, ``node.create_service(*SOLVE, callback)``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from diagnostic_msgs.srv import SelfTest
from geometry_msgs.msg import (
    PointStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    WrenchStamped,
)
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.msg import Odometry
from nav_msgs.srv import GetPlan
from rclpy.qos import (
    DurabilityPolicy,
    qos_profile_sensor_data,
    QoSProfile,
    ReliabilityPolicy,
)
from sensor_msgs.msg import Imu, JointState, Range
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool, Trigger

# Goals, poses and setpoints. Fast DDS 2.14 lost the first message of a volatile publisher in every
# other run of a test, although the publisher had already counted its subscriber.
COMMAND = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
COMMANDS = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# States: a later subscriber receives the last message, or the last ten.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
RECENT = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Measurements: a later subscriber receives no past message.
TELEMETRY = QoSProfile(depth=10, durability=DurabilityPolicy.VOLATILE)
NEWEST = QoSProfile(depth=1, durability=DurabilityPolicy.VOLATILE)
SENSOR = qos_profile_sensor_data
# measurements of a sensor that may wait while an estimate is computed: 1000 Hz for 0.1 s
QUEUE = QoSProfile(
    depth=100,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)


class Topic(NamedTuple):
    """Topic: message type, name, and the quality of service of its publishers."""

    type: type[Any]
    name: str
    qos: QoSProfile

    def __hash__(self) -> int:
        """Return the hash of the name, because a QoSProfile is not hashable."""
        return hash(self.name)

    @property
    def subscription_qos(self) -> QoSProfile:
        """
        Return the quality of service for subscriptions, which are volatile.

        A volatile subscription receives from every publisher, also from `ros2 topic pub`, and no
        message from before the subscription.
        """
        return QoSProfile(
            depth=self.qos.depth,
            reliability=self.qos.reliability,
            durability=DurabilityPolicy.VOLATILE,
        )


class LatchedTopic(Topic):
    """Topic of a state, whose last messages also reach later subscribers."""

    __slots__ = ()

    @property
    def subscription_qos(self) -> QoSProfile:
        """Return the quality of service for subscriptions; it equals that of the publishers."""
        return self.qos


class Service(NamedTuple):
    """ROS service: interface type and name."""

    type: type[Any]
    name: str


GOAL_POSE = Topic(PoseStamped, 'goal_pose', COMMAND)
DISTURBANCE = Topic(PoseWithCovarianceStamped, 'disturbance', SENSOR)
DISTURBANCE_ODOMETRY = Topic(Odometry, 'disturbance_odometry', SENSOR)
CONTACT_WRENCH = Topic(WrenchStamped, 'contact_wrench', SENSOR)
LATERAL_OFFSET = Topic(PointStamped, 'lateral_offset', SENSOR)
CORRECTED_POSE = Topic(PoseStamped, 'corrected_pose', COMMAND)
REFERENCE = Topic(PoseStamped, 'compensator/reference', TELEMETRY)
GOAL_STATUS = LatchedTopic(DiagnosticStatus, 'compensator/goal_status', LATCHED)
JOINT_SETPOINTS = Topic(JointState, 'joint_setpoints', COMMAND)
JOINT_STATES = Topic(JointState, 'joint_states', TELEMETRY)
END_EFFECTOR_POSE = Topic(PoseStamped, 'end_effector_pose', TELEMETRY)
REJECTIONS = LatchedTopic(DiagnosticStatus, 'ik_service/rejections', RECENT)
ROBOT_DESCRIPTION = LatchedTopic(String, 'robot_description', LATCHED)
MECHANISM_STATES = Topic(JointState, 'ik_service/joint_states', TELEMETRY)
DRIVER_STATUS = LatchedTopic(DiagnosticStatus, 'driver/status', LATCHED)
SOFTWARE_STOP = Topic(Bool, 'software_stop', COMMANDS)
IMU = Topic(Imu, 'imu', QUEUE)
RANGE_1 = Topic(Range, 'range_1', QUEUE)
RANGE_2 = Topic(Range, 'range_2', QUEUE)
FIX_X = Topic(PointStamped, 'fix_x', QUEUE)
FIX_POSE = Topic(PoseWithCovarianceStamped, 'fix_pose', QUEUE)
HEAD_ON_WALL = Topic(PoseStamped, 'head_on_wall', SENSOR)
CARRIAGE_FORCES = Topic(JointState, 'gondola_simulator/carriage_forces', NEWEST)
HEAD_POSE = Topic(PoseStamped, 'gondola_simulator/head_pose', TELEMETRY)
RAIL_POSE = Topic(PoseStamped, 'gondola_simulator/rail_pose', TELEMETRY)
WALL_ERROR = Topic(PoseStamped, 'gondola_simulator/wall_error', TELEMETRY)
UNCOMPENSATED_ERROR = Topic(
    PoseStamped, 'gondola_simulator/uncompensated_error', TELEMETRY
)
DIAGNOSTICS = Topic(DiagnosticArray, '/diagnostics', TELEMETRY)

SOLVE = Service(GetPlan, 'ik_service/solve')
ENABLE = Service(SetBool, 'compensator/enable')
HOLD = Service(Trigger, 'compensator/hold')
TARE = Service(Trigger, 'compensator/tare')
CHANGE_STATE = Service(ChangeState, 'driver/change_state')
GET_STATE = Service(GetState, 'driver/get_state')
HOME = Service(Trigger, 'driver/home')
HALT = Service(Trigger, 'driver/halt')
CLEAR_FAULTS = Service(Trigger, 'driver/clear_faults')
SELF_TEST = Service(SelfTest, 'driver/self_test')
