"""What a press does to the gondola in the end, from statics alone: known before the head moves."""

from __future__ import annotations

import math

from facade_manipulator.compensation.impedance import ImpedanceSettings
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.parameters import parameter, settings

GRAVITY = 9.81


@settings
class SuspensionSettings:
    """How the gondola hangs, to check a press beforehand."""

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
        0.0, 'Distance of either end of the guide from the middle', unit='m', minimum=0.0,
        maximum=10.0)

    def push_back(self, force: float) -> float:
        """Return how far a force [N] pushes the gondola off the wall [m]."""
        return force / (self.mass * GRAVITY / self.cable_length + self.guide_stiffness)

    def yaw(self, force: float, x: float) -> float:
        """Return how far a force [N] at a place x [m] along the rail turns the gondola [rad]."""
        half = 0.5 * self.cable_distance
        cables = self.mass * GRAVITY * half ** 2 / self.cable_length
        return force * abs(x) / (cables + self.guide_stiffness * self.guide_lever ** 2)


def obstacle(
    suspension: SuspensionSettings, press: ImpedanceSettings, geometry: Geometry, goal: Pose
) -> str:
    """Return why the desired force cannot be had at a goal on the wall, empty if it can."""
    if not press.enabled or suspension.mass == 0.0:
        return ''
    force, length = press.force, suspension.cable_length
    yaw, back = suspension.yaw(force, goal.x), suspension.push_back(force)
    if yaw > press.most_yaw:
        return (f'{force:g} N at {abs(goal.x):g} m on {length:g} m of free cable turns the '
                f'gondola by {math.degrees(yaw):.0f} deg, bound '
                f'{math.degrees(press.most_yaw):.0f} deg')
    if goal.y + back > geometry.link_length:
        return (f'{force:g} N on {length:g} m of free cable push the gondola back by '
                f'{1e3 * back:.0f} mm: the goal is then {goal.y + back:.3f} m away, reach '
                f'{geometry.link_length:g} m')
    return ''
