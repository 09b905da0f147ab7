"""
The mechanism as it is: the one on the drawing, or the one that was made and measured.

Both have the functions of this room that take a Geometry as methods, with the same arguments,
results and errors, and what `CalibratedMechanism` adds. Poses are those of the head in frame
`rail`, carriages are positions as the drives count them. Which of the two is chosen once, where a
node starts; nothing asks again in a cycle.
"""

from __future__ import annotations

from functools import partial

from facade_manipulator.kinematics import inverse
from facade_manipulator.kinematics.calibrated import CalibratedMechanism
from facade_manipulator.kinematics.forward import certify_carriages, forward_kinematics
from facade_manipulator.kinematics.geometry import Geometry, Pose
from facade_manipulator.kinematics.jacobian import end_effector_force, jacobian


class NominalMechanism:
    """
    The mechanism of the drawing.

    Only the nominal lengths of the geometry count.
    """

    def __init__(self, geometry: Geometry) -> None:
        self.geometry = geometry
        self.inverse_kinematics = partial(inverse.inverse_kinematics, geometry)
        self.forward_kinematics = partial(forward_kinematics, geometry)
        self.jacobian = partial(jacobian, geometry)
        self.carriage_velocity = partial(inverse.carriage_velocity, geometry)
        self.end_effector_force = partial(end_effector_force, geometry)
        self.certify = partial(inverse.certify, geometry)
        self.check = partial(certify_carriages, geometry)
        self.take_up = partial(inverse.take_up, geometry)

    def platform(self, head: Pose) -> Pose:
        """Return the head: it is the platform's middle joint."""
        return head

    head = platform

    def on_rail(self, carriages: tuple[float, float, float]) -> tuple[float, float, float]:
        """Return the carriages as the drives count them [m], which are right on the drawing."""
        return carriages


Mechanism = NominalMechanism | CalibratedMechanism


def mechanism_of(geometry: Geometry) -> Mechanism:
    """Return the mechanism of a geometry: the nominal one where no error is given."""
    return (NominalMechanism if geometry.is_nominal else CalibratedMechanism)(geometry)
