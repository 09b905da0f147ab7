"""
Where the head really is: errors of the machine, of estimator and sensors, place of the wall.

In: measurements and recordings. Out: parameters with their covariance, and what the data cannot
identify. Pure but for its command, `calibrate` (`python -m facade_manipulator.tools.calibration`);
scipy is loaded where it is needed and by no node.
"""

from .design import candidates as candidates
from .design import Noise as Noise
from .design import plan as plan
from .design import spread as spread
from .estimator_fit import EstimatorRecording as EstimatorRecording
from .estimator_fit import fit_estimator as fit_estimator
from .geometry_fit import identify as identify
from .geometry_fit import Measurements as Measurements
from .plan_file import fill as fill
from .plan_file import read_measured as read_measured
from .recorded import read_estimator_recording as read_estimator_recording
from .sensor_fit import fit_sensors as fit_sensors
from .sensor_fit import SensorRecording as SensorRecording
from .tables import read_rows as read_rows
from .tables import read_table as read_table
from .target import Sought as Sought
from .unknowns import head_at as head_at
from .unknowns import heads as heads
from .unknowns import UNKNOWNS as UNKNOWNS
from .unknowns import unknowns_named as unknowns_named
from .unknowns import values_of as values_of
from .wall_fit import fit_wall as fit_wall
from .wall_fit import touched_points as touched_points
