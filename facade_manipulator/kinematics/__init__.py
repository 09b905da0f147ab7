"""
Kinematics of the mechanism: poses and carriages in, numbers out.

SI units and radians. Frame `rail`: x along the rail, y out towards the façade, θ about z. The
carriages A1, A3, A2 stand on y = 0 in that order; q3 = x.
"""

from facade_manipulator.kinematics.assembly import assembly_modes
from facade_manipulator.kinematics.batch import forward_kinematics_batch, inverse_kinematics_batch
from facade_manipulator.kinematics.forward import forward_kinematics
from facade_manipulator.kinematics.geometry import (
    Carriages,
    Geometry,
    not_finite,
    Pose,
    Twist,
    Wrench,
)
from facade_manipulator.kinematics.inverse import (
    branch_number,
    carriage_velocity,
    certify,
    inverse_kinematics,
    links,
    MIN_CONDITIONING,
    squared_index,
    WorkingMode,
)
from facade_manipulator.kinematics.jacobian import (
    check_characteristic_length,
    end_effector_force,
    jacobian,
    local_conditioning_index,
    parallel_singularity,
    platform_velocity,
)
from facade_manipulator.kinematics.linkage import JointPoints, joints, Point
from facade_manipulator.kinematics.mechanism import Mechanism, mechanism_of
from facade_manipulator.kinematics.planar import (
    add,
    compose,
    difference,
    invert,
    MotionState,
    relative,
    subtract,
    wrap_angle,
    ZERO_POSE,
    ZERO_STATE,
    ZERO_TWIST,
)
from facade_manipulator.kinematics.statics import carriage_forces, certify_load, head_stiffness

__all__ = [
    'add',
    'assembly_modes',
    'branch_number',
    'carriage_forces',
    'carriage_velocity',
    'Carriages',
    'certify',
    'certify_load',
    'check_characteristic_length',
    'compose',
    'difference',
    'end_effector_force',
    'forward_kinematics',
    'forward_kinematics_batch',
    'Geometry',
    'head_stiffness',
    'inverse_kinematics',
    'inverse_kinematics_batch',
    'invert',
    'jacobian',
    'JointPoints',
    'joints',
    'links',
    'local_conditioning_index',
    'Mechanism',
    'mechanism_of',
    'MIN_CONDITIONING',
    'MotionState',
    'not_finite',
    'parallel_singularity',
    'platform_velocity',
    'Point',
    'Pose',
    'relative',
    'squared_index',
    'subtract',
    'Twist',
    'WorkingMode',
    'wrap_angle',
    'Wrench',
    'ZERO_POSE',
    'ZERO_STATE',
    'ZERO_TWIST',
]
