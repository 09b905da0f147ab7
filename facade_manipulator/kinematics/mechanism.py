"""
The mechanism as it is: the one on the drawing, or the one that was made and measured.

Which of the two is chosen once, where a node starts; nothing asks again in a cycle.
"""

from __future__ import annotations

from functools import partial
from typing import Protocol

import numpy as np

from facade_manipulator.kinematics.assembly import assembly_modes
from facade_manipulator.kinematics.calibrated import CalibratedMechanism
from facade_manipulator.kinematics.certify import (
    certify,
    check_branch,
    check_carriages,
    MIN_CONDITIONING,
)
from facade_manipulator.kinematics.forward import forward_kinematics
from facade_manipulator.kinematics.geometry import Carriages, Geometry, Pose, Twist, Wrench
from facade_manipulator.kinematics.inverse import inverse_kinematics, links
from facade_manipulator.kinematics.jacobian import (
    carriage_velocity,
    end_effector_force,
    jacobian,
)
from facade_manipulator.kinematics.modes import WorkingMode


class Mechanism(Protocol):
    """
    What the functions of this room answer for a Geometry, for the machine that is there.

    Poses are those of the head in frame `rail`, carriages are positions as the drives count
    them. Arguments, results and errors are those of the functions of the same names.
    """

    geometry: Geometry

    def inverse_kinematics(
        self, pose: Pose, working_mode: WorkingMode = WorkingMode.PLUS_MINUS
    ) -> Carriages:
        """Carriage positions of a pose of the head."""

    def forward_kinematics(self, carriages: Carriages) -> Pose:
        """Pose of the head on the machine's branch."""

    def assembly_modes(self, carriages: Carriages) -> list[Pose]:
        """All real poses of the head."""

    def jacobian(self, pose: Pose) -> np.ndarray:
        """Jacobian from rates of the head to carriage rates."""

    def carriage_velocity(self, pose: Pose, velocity: Twist) -> Carriages:
        """Carriage velocities of a velocity of the head."""

    def end_effector_force(self, pose: Pose, carriage_forces: Carriages) -> Wrench:
        """Wrench that carriage forces exert through the head."""

    def certify(
        self, pose: Pose, min_conditioning: float = MIN_CONDITIONING,
        characteristic_length: float | None = None,
    ) -> Carriages:
        """Check a pose of the head against all limits; return its carriage positions."""

    def check(self, carriages: Carriages) -> None:
        """Check that the mechanism closes at carriage positions and may stand there."""

    def on_rail(self, carriages: Carriages) -> Carriages:
        """Return where on the rail carriages stand."""

    def take_up(self, carriages: Carriages, velocity: Carriages) -> Carriages:
        """Return where to send the drives so that moving carriages are where they should be."""

    def platform(self, head: Pose) -> Pose:
        """Pose of the platform's middle joint on the real rail, for a pose of the head."""

    def head(self, platform: Pose) -> Pose:
        """Pose of the head, for one of the platform."""


class NominalMechanism:
    """
    The mechanism of the drawing.

    Parameters
    ----------
    geometry : Geometry
        Of which only the nominal lengths count.

    """

    def __init__(self, geometry: Geometry) -> None:
        self.geometry = geometry
        self.inverse_kinematics = partial(inverse_kinematics, geometry)
        self.forward_kinematics = partial(forward_kinematics, geometry)
        self.assembly_modes = partial(assembly_modes, geometry)
        self.jacobian = partial(jacobian, geometry)
        self.carriage_velocity = partial(carriage_velocity, geometry)
        self.end_effector_force = partial(end_effector_force, geometry)
        self.certify = partial(certify, geometry)

    def check(self, carriages: Carriages) -> None:
        """Check carriage positions."""
        check_carriages(self.geometry, carriages)
        # Its carriages are these, so of `certify` only reach and branch are left.
        check_branch(links(self.geometry, forward_kinematics(self.geometry, carriages)))

    def on_rail(self, carriages: Carriages) -> Carriages:
        """Return the carriages: the drives are right."""
        return carriages

    def take_up(self, carriages: Carriages, _: Carriages) -> Carriages:
        """Return the carriages: there is no play."""
        return carriages

    def platform(self, head: Pose) -> Pose:
        """Return the head: it is the platform's middle joint."""
        return head

    head = platform


def mechanism_of(geometry: Geometry) -> Mechanism:
    """Return the mechanism of a geometry: the nominal one where no error is given."""
    return (NominalMechanism if geometry.is_nominal else CalibratedMechanism)(geometry)
