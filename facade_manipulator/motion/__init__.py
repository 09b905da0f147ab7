"""
Motion inside limits: poses in, setpoints and carriage targets out.

For ik_service: `Approach` and `ReferencePath` (jerk-limited paths of the head), `SetpointStream`
(certified poses to setpoints). For the driver: `SetpointFollower` (setpoints to targets within
speed, acceleration and jerk) and the guards that check the mechanism before a target is sent.
"""

from .braking import Brake as Brake
from .braking import displacements as displacements
from .braking import highest_speed as highest_speed
from .braking import least_distance as least_distance
from .braking import overshoot as overshoot
from .braking import starting_distances as starting_distances
from .follower import SetpointFollower as SetpointFollower
from .follower import StreamSettings as StreamSettings
from .guard import homing_guard as homing_guard
from .guard import measured_guard as measured_guard
from .guard import MEASURED_SHARE as MEASURED_SHARE
from .guard import mechanism_guard as mechanism_guard
from .limits import fastest_near as fastest_near
from .limits import MotionLimits as MotionLimits
from .limits import Separation as Separation
from .limits import Triple as Triple
from .limits import triple as triple
from .reference import Approach as Approach
from .reference import HeadMotion as HeadMotion
from .reference import ReferencePath as ReferencePath
from .reference import ReferenceSettings as ReferenceSettings
from .setpoints import GoalSettings as GoalSettings
from .setpoints import Setpoint as Setpoint
from .setpoints import SetpointStream as SetpointStream
from .setpoints import STREAM_GAP as STREAM_GAP
from .timed_buffer import KEPT_TIME as KEPT_TIME
from .timed_buffer import TimedBuffer as TimedBuffer
