"""
What the nodes share of ROS: messages to core values and back, parameters, life cycle, diagnostics.

Everything that rclpy offers beyond its public interface is used in this package alone.
"""

from .client import ManipulatorClient as ManipulatorClient
from .clocks import steady_timer as steady_timer
from .clocks import steady_timers as steady_timers
from .codec import Codec as Codec
from .codec import estimate_codec as estimate_codec
from .codec import IMU_FIELDS as IMU_FIELDS
from .codec import odometry_codec as odometry_codec
from .codec import POINT_FIELDS as POINT_FIELDS
from .codec import pose_codec as pose_codec
from .codec import RANGE_FIELDS as RANGE_FIELDS
from .codec import SensorReader as SensorReader
from .codec import setpoint_codec as setpoint_codec
from .codec import states_codec as states_codec
from .conversions import frames as frames
from .conversions import node_time as node_time
from .conversions import pose_message as pose_message
from .conversions import pose_stamped as pose_stamped
from .conversions import PoseStream as PoseStream
from .conversions import stamp as stamp
from .conversions import Transforms as Transforms
from .conversions import wrench_stamped as wrench_stamped
from .diagnostics import diagnostic_status as diagnostic_status
from .diagnostics import DiagnosticsPublisher as DiagnosticsPublisher
from .diagnostics import DriverStatus as DriverStatus
from .diagnostics import DriverWatch as DriverWatch
from .diagnostics import goal_status as goal_status
from .diagnostics import LEVELS as LEVELS
from .diagnostics import RejectedGoal as RejectedGoal
from .diagnostics import rejection_status as rejection_status
from .diagnostics import Rejections as Rejections
from .diagnostics import SILENCE as SILENCE
from .diagnostics import SILENT as SILENT
from .diagnostics import STATUS_PERIOD as STATUS_PERIOD
from .interfaces import class_of as class_of
from .interfaces import client as client
from .interfaces import incompatible as incompatible
from .interfaces import is_installed as is_installed
from .interfaces import profile as profile
from .interfaces import publisher as publisher
from .interfaces import service as service
from .interfaces import subscription as subscription
from .known_parameters import name_unknown_parameters as name_unknown_parameters
from .lifecycle import Deferred as Deferred
from .lifecycle import ManagedNode as ManagedNode
from .lifecycle import may_defer as may_defer
from .lifecycle import offer_trigger as offer_trigger
from .message_queues import Arrived as Arrived
from .message_queues import MessageQueue as MessageQueue
from .message_queues import MessageQueues as MessageQueues
from .parameters import declare as declare
from .parameters import parameter_checksum as parameter_checksum
from .publisher_watch import PublisherWatch as PublisherWatch
from .rclpy_internals import ROSError as ROSError
from .runtime import initialise as initialise
from .runtime import ros_errors as ros_errors
from .runtime import run as run
from .runtime import USAGE_ERROR as USAGE_ERROR
from .software_stop import SoftwareStop as SoftwareStop
from .software_stop import subscribe_software_stops as subscribe_software_stops
