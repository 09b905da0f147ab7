"""
Kinematics of the mechanism: poses, carriages, certification, Jacobian, arrays, URDF.

SI units and radians. Frame `rail`: x along the rail, y out towards the façade, θ about z. The
carriages A1, A3, A2 are on y = 0 in that order; q3 = x. Functions of a `Geometry` describe the
drawing. `Mechanism` includes the errors of the machine as built. Arrays of poses are in
`facade_manipulator.kinematics.maps`. No name here imports numpy before its first use: the control
loop runs without numpy, which saves it 8 MiB.
"""

from .description import joints as joints
from .description import positions as positions
from .description import tree as tree
from .description import urdf as urdf
from .forward import assembly_modes as assembly_modes
from .forward import forward_kinematics as forward_kinematics
from .geometry import Carriages as Carriages
from .geometry import Geometry as Geometry
from .geometry import GRAVITY as GRAVITY
from .geometry import not_finite as not_finite
from .geometry import Pose as Pose
from .geometry import Twist as Twist
from .geometry import Wrench as Wrench
from .inverse import branch_number as branch_number
from .inverse import CONDITIONING_RATIO as CONDITIONING_RATIO
from .inverse import inverse_kinematics as inverse_kinematics
from .inverse import links as links
from .inverse import MIN_CONDITIONING as MIN_CONDITIONING
from .inverse import squared_index as squared_index
from .inverse import working_modes as working_modes
from .jacobian import jacobian as jacobian
from .jacobian import local_conditioning_index as local_conditioning_index
from .jacobian import parallel_singularity as parallel_singularity
from .mechanism import Mechanism as Mechanism
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
