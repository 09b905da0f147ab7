"""
What the nodes share of ROS: messages to core values and back, parameters, life cycle, diagnostics.

Everything that rclpy offers beyond its public interface is used in this package alone.
"""

from facade_manipulator.ros.client import Component, ManipulatorClient
from facade_manipulator.ros.clocks import reject_simulated_time, steady_timer
from facade_manipulator.ros.codec import (
    estimate_codec,
    pose_codec,
    setpoint_codec,
    states_codec,
)
from facade_manipulator.ros.conversions import (
    node_time,
    pose_message,
    pose_stamped,
    PoseStream,
    stamp,
    Transforms,
    wrench_stamped,
)
from facade_manipulator.ros.diagnostics import (
    diagnostic_status,
    DiagnosticsPublisher,
    DRIVER_STATUS,
    DriverStatus,
    DriverWatch,
    followed_goal,
    GOAL_STATUS,
    goal_status,
    HOLD,
    LEVELS,
    rejection_status,
    Rejections,
    stamp_text,
)
from facade_manipulator.ros.known_parameters import accept_old_names, require_known_parameters
from facade_manipulator.ros.lifecycle import (
    Deferred,
    DeferredReplies,
    ManagedNode,
    offer_trigger,
)
from facade_manipulator.ros.parameters import declare
from facade_manipulator.ros.recording import message_type, MessageQueue, ParameterReader
from facade_manipulator.ros.runtime import LATCHED, LATEST, RECENT, RELIABLE, run, USAGE_ERROR
from facade_manipulator.ros.software_stop import SoftwareStop

__all__ = [
    'accept_old_names',
    'Component',
    'declare',
    'Deferred',
    'DeferredReplies',
    'diagnostic_status',
    'DiagnosticsPublisher',
    'DRIVER_STATUS',
    'DriverStatus',
    'DriverWatch',
    'estimate_codec',
    'followed_goal',
    'GOAL_STATUS',
    'goal_status',
    'HOLD',
    'LATCHED',
    'LATEST',
    'LEVELS',
    'ManagedNode',
    'ManipulatorClient',
    'message_type',
    'MessageQueue',
    'node_time',
    'offer_trigger',
    'ParameterReader',
    'pose_codec',
    'pose_message',
    'pose_stamped',
    'PoseStream',
    'RECENT',
    'reject_simulated_time',
    'rejection_status',
    'Rejections',
    'RELIABLE',
    'require_known_parameters',
    'run',
    'setpoint_codec',
    'SoftwareStop',
    'stamp',
    'stamp_text',
    'states_codec',
    'steady_timer',
    'Transforms',
    'USAGE_ERROR',
    'wrench_stamped',
]
