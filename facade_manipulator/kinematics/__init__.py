"""
Kinematics of the mechanism: poses and carriages in, numbers out.

SI units and radians. Frame `rail`: x along the rail, y out towards the façade, θ about z. The
carriages A1, A3, A2 stand on y = 0 in that order; q3 = x.
"""

from facade_manipulator.kinematics.assembly import assembly_modes
from facade_manipulator.kinematics.batch import forward_kinematics_batch, inverse_kinematics_batch
from facade_manipulator.kinematics.certify import certify, check_carriages, MIN_CONDITIONING
from facade_manipulator.kinematics.conditioning import local_conditioning_index
from facade_manipulator.kinematics.forward import forward_kinematics
from facade_manipulator.kinematics.geometry import Carriages, Geometry, Pose, Twist, Wrench
from facade_manipulator.kinematics.inverse import inverse_kinematics
from facade_manipulator.kinematics.jacobian import (
    carriage_velocity,
    end_effector_force,
    jacobian,
    parallel_singularity,
    platform_velocity,
)
from facade_manipulator.kinematics.modes import WorkingMode

__all__ = [
    'assembly_modes',
    'Carriages',
    'carriage_velocity',
    'certify',
    'check_carriages',
    'end_effector_force',
    'forward_kinematics',
    'forward_kinematics_batch',
    'Geometry',
    'inverse_kinematics',
    'inverse_kinematics_batch',
    'jacobian',
    'local_conditioning_index',
    'MIN_CONDITIONING',
    'parallel_singularity',
    'platform_velocity',
    'Pose',
    'Twist',
    'Wrench',
    'WorkingMode',
]
