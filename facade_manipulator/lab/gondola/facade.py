"""
The façade as the cleaning head feels it: a brush on a wall with steps, springy, damped and rough.

The brush is pressed at both its ends, so that its yaw to the wall makes a moment. A step of the
wall has a ramp as long as the brush needs to roll over its edge.
"""

from __future__ import annotations

import math

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Pose, Twist, Wrench
from facade_manipulator.parameters import parameter, settings

ENDS = (-0.5, 0.5)


@settings
class FacadeSettings:
    """Where the wall is, how the brush feels on it, and its steps."""

    present: bool = parameter('Whether there is a wall to touch', default=False)
    distance: float = parameter(
        'Distance of the wall from the rail in still air', default=0.23, unit='m', minimum=-10.0,
        maximum=10.0)
    stiffness: float = parameter(
        'Stiffness of the brush', default=600.0, unit='N/m', minimum=1.0, maximum=1e6)
    wall_stiffness: float = parameter(
        'Stiffness of the wall behind the brush', default=1e7, unit='N/m', minimum=1.0,
        maximum=1e9)
    damping: float = parameter(
        'Damping of the brush', default=25.0, unit='N s/m', minimum=0.0, maximum=1e5)
    friction: float = parameter('Coefficient of friction', default=0.3, minimum=0.0, maximum=3.0)
    friction_speed: float = parameter(
        'Speed at which friction is nearly full', default=0.01, unit='m/s', minimum=1e-4,
        maximum=1.0)
    width: float = parameter('Width of the brush', default=0.3, unit='m', minimum=0.0, maximum=5.0)
    step_positions: tuple[float, ...] = parameter(
        'Where the wall steps, ascending along x', default=(), unit='m', minimum=-100.0,
        maximum=100.0)
    step_heights: tuple[float, ...] = parameter(
        'By how much it steps towards the gondola at each place', default=(), unit='m',
        minimum=-1.0, maximum=1.0)
    step_length: float = parameter(
        'Length over which the brush rolls over the edge of a step', default=0.06, unit='m',
        minimum=1e-3, maximum=1.0)

    def __post_init__(self) -> None:
        if len(self.step_positions) != len(self.step_heights):
            raise ParameterError(
                f'step_positions has {len(self.step_positions)} elements, step_heights '
                f'{len(self.step_heights)}')

    @property
    def brush_share(self) -> float:
        """Share of the depth that the brush takes, the wall behind it the remainder."""
        return self.wall_stiffness / (self.wall_stiffness + self.stiffness)


NO_CONTACT = Wrench(0.0, 0.0, 0.0)


class Facade:
    """Contact of the head with the wall."""

    def __init__(self, settings: FacadeSettings) -> None:
        self.settings = settings

    def distance(self, x: float) -> float:
        """Return the distance of the wall from the rail's nominal place at x [m]."""
        length = self.settings.step_length
        return self.settings.distance - sum(
            height * _smooth((x - place) / length + 0.5)
            for place, height in zip(
                self.settings.step_positions, self.settings.step_heights, strict=True))

    def contact(self, head: Pose, velocity: Twist) -> Wrench:
        """Return the wrench of the wall on the head, in its frame; both are in the façade's."""
        if not self.settings.present:
            return NO_CONTACT
        pressure, moment = 0.0, 0.0
        for end in ENDS:
            arm = end * self.settings.width
            force = self._pressure(head, velocity, arm)
            pressure += force
            moment -= force * arm * math.cos(head.theta)
        slip = math.tanh(velocity.x / self.settings.friction_speed)
        friction = -self.settings.friction * pressure * slip
        cosine, sine = math.cos(head.theta), math.sin(head.theta)
        return Wrench(
            cosine * friction - sine * pressure, -sine * friction - cosine * pressure, moment)

    @staticmethod
    def force_on_wall(head: Pose, wrench: Wrench) -> float:
        """Return the force with which the head presses on the wall [N]."""
        return -(math.sin(head.theta) * wrench.fx + math.cos(head.theta) * wrench.fy)

    def _pressure(self, head: Pose, velocity: Twist, arm: float) -> float:
        """Return the force on one end of the brush, 0 where it does not touch."""
        x = head.x + arm * math.cos(head.theta)
        depth = head.y + arm * math.sin(head.theta) - self.distance(x)
        if depth <= 0.0:
            return 0.0
        rate = velocity.y + arm * math.cos(head.theta) * velocity.theta
        share = self.settings.brush_share / len(ENDS)
        # only the brush damps, by what it deflects and as much as its share of the power
        damping = self.settings.brush_share * self.settings.damping
        return max(share * (self.settings.stiffness * depth + damping * rate), 0.0)


def _smooth(share: float) -> float:
    share = min(max(share, 0.0), 1.0)
    return share * share * (3.0 - 2.0 * share)
