"""
Where the rail is on the façade, from sensors that can be bought.

In: turning rates and accelerations, distances of the wall, features or poses seen, each with its
stamp. Out: pose and velocity of the rail, with covariances that hold; what became of each sensor's
measurements, and events with their reasons.
"""

from .association import SensorRecord as SensorRecord
from .estimator import DisturbanceEstimator as DisturbanceEstimator
from .estimator import EstimatorEvent as EstimatorEvent
from .estimator import RailMotion as RailMotion
from .messages import Add as Add
from .messages import add_fix as add_fix
from .messages import add_imu as add_imu
from .messages import add_pose as add_pose
from .messages import add_range as add_range
from .messages import inputs as inputs
from .settings import DistanceSettings as DistanceSettings
from .settings import EstimatorSetup as EstimatorSetup
from .settings import FixSettings as FixSettings
from .settings import ImuSettings as ImuSettings
from .settings import PoseFixSettings as PoseFixSettings
from .settings import ProfileSettings as ProfileSettings
from .settings import SensorNames as SensorNames
