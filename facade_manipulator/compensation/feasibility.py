"""What a press does to the gondola in the end, from statics alone: known before the head moves."""

from __future__ import annotations

import math

from facade_manipulator.compensation.impedance import ImpedanceSettings
from facade_manipulator.compensation.suspension import SuspensionSettings
from facade_manipulator.kinematics import Geometry, Pose


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
