"""How the gondola hangs: what a force does to it in the end, how much energy its swing has."""

from __future__ import annotations

import math

from facade_manipulator.kinematics import MotionState
from facade_manipulator.motion import Triple
from facade_manipulator.parameters import parameter, settings

GRAVITY = 9.81
FRICTION = 0.3  # of a brush on the wall
DAMPING_RATIO = 0.02  # usual of a gondola on cables
HARMONICS = (1, 3, 5, 7)
TOLERANCES = tuple(1.0 + 0.01 * percent for percent in range(-5, 6))  # of the periods


@settings
class SuspensionSettings:
    """
    How the gondola hangs: on two cables, held at the wall by a guide.

    Each axis counts as a pendulum of its own, the body hanging straight below its cables.
    """

    mass: float = parameter(
        0.0, 'Mass of the gondola; 0 if it is not known, then no press is checked', unit='kg',
        minimum=0.0, maximum=1e5)
    cable_length: float = parameter(
        30.0, 'Free length of the cables', unit='m', minimum=1.0, maximum=500.0)
    cable_distance: float = parameter(
        1.2, 'Distance of the two cables', unit='m', minimum=0.1, maximum=20.0)
    guide_stiffness: float = parameter(
        0.0, 'Stiffness of the guide that keeps the gondola at the wall', unit='N/m',
        minimum=0.0, maximum=1e6)
    guide_lever: float = parameter(
        0.0, 'Distance of either end of the guide from the middle; 0 for one guide there',
        unit='m', minimum=0.0, maximum=10.0)
    yaw_radius: float = parameter(
        0.7, 'Radius of gyration about the vertical axis', unit='m', minimum=0.05, maximum=10.0)

    @property
    def stiffness(self) -> Triple:
        """With what it turns back in x, y and yaw [N/m, N/m, N m/rad]."""
        cables = self.mass * GRAVITY / self.cable_length
        return (cables, cables + self.guide_stiffness,
                cables * (0.5 * self.cable_distance) ** 2
                + self.guide_stiffness * self.guide_lever ** 2)

    @property
    def inertia(self) -> Triple:
        """What it has to move in x, y and yaw [kg, kg, kg m²]."""
        return self.mass, self.mass, self.mass * self.yaw_radius ** 2

    @property
    def periods(self) -> Triple:
        """Periods of x, y and yaw [s]."""
        return tuple(
            math.tau * math.sqrt(m / k) for m, k in zip(self.inertia, self.stiffness, strict=True))

    def swing(self, force: float, amplitude: float, period: float) -> tuple[float, float]:
        """
        Return how far strokes swing the gondola in the end along the wall [m] and in yaw [rad].

        Friction along the wall is a square wave, the place of the force nearly one: their odd
        harmonics excite the pendulums, which take the worst period within 5 %.

        Parameters
        ----------
        force : float
            On the wall [N].
        amplitude, period : float
            Of the strokes, half their length [m], and to and fro [s].

        """
        periods, (along, _, turning) = self.periods, self.stiffness
        x = FRICTION * force / along * _harmonics(periods[0] / period)
        return x, force * (amplitude + x) / turning * _harmonics(periods[2] / period)

    def push_back(self, force: float) -> float:
        """Return how far a force [N] pushes the gondola off the wall [m]."""
        return force / self.stiffness[1]

    def yaw(self, force: float, x: float) -> float:
        """Return how far a force [N] at a place x [m] along the rail turns the gondola [rad]."""
        return force * abs(x) / self.stiffness[2]

    def energy(self, swing: MotionState) -> Triple:
        """Return the energy of a swing about the rest in x, y and yaw [J]."""
        return tuple(
            0.5 * (k * position ** 2 + m * velocity ** 2) for k, m, position, velocity in zip(
                self.stiffness, self.inertia, *swing, strict=True))


def _harmonics(ratio: float) -> float:
    """Return how far a square wave moves a pendulum whose period is that many of the wave's."""
    return max(sum(
        4.0 / (math.pi * n) / abs(1.0 - (n * r) ** 2 + 2j * DAMPING_RATIO * n * r)
        for n in HARMONICS) for r in (ratio * tolerance for tolerance in TOLERANCES))
