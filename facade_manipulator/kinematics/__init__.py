"""
Kinematics of the mechanism: poses, carriages, certification, Jacobian, arrays and URDF.

SI units and radians. Frame `rail`: x along the rail, y out towards the façade, θ about z. The
carriages A1, A3, A2 are on y = 0 in that order; q3 = x. Functions of a `Geometry` describe the
drawing. `Mechanism` includes the errors of the machine as built. Arrays of poses are in
`facade_manipulator.kinematics.maps`. No name here imports numpy before its first use: the control
loop runs without numpy, which saves 8 MiB of memory.
"""

from .description import joints as joints
from .description import positions as positions
from .description import tree as tree
from .description import urdf as urdf
from .geometry import Carriages as Carriages
from .geometry import Geometry as Geometry
from .geometry import GRAVITY as GRAVITY
from .geometry import not_finite_error as not_finite_error
from .geometry import Pose as Pose
from .geometry import Twist as Twist
from .geometry import Wrench as Wrench
from .links import branch_number as branch_number
from .links import squared_index as squared_index
from .mechanism import CONDITIONING_RATIO as CONDITIONING_RATIO
from .mechanism import Mechanism as Mechanism
from .mechanism import MIN_CONDITIONING as MIN_CONDITIONING
from .nominal import assembly_modes as assembly_modes
from .nominal import forward_kinematics as forward_kinematics
from .nominal import inverse_kinematics as inverse_kinematics
from .nominal import jacobian as jacobian
from .nominal import links as links
from .nominal import local_conditioning_index as local_conditioning_index
from .nominal import parallel_singularity as parallel_singularity
from .nominal import working_modes as working_modes
from .planar import add as add
from .planar import compose as compose
from .planar import difference as difference
from .planar import invert as invert
from .planar import MotionState as MotionState
from .planar import relative as relative
from .planar import subtract as subtract
from .planar import wrap_angle as wrap_angle
from .planar import ZERO_POSE as ZERO_POSE
from .planar import ZERO_STATE as ZERO_STATE
from .planar import ZERO_TWIST as ZERO_TWIST
