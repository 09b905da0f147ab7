"""What a press and its strokes do to the gondola in the end: known before it has happened."""

from __future__ import annotations

import math

from facade_manipulator.compensation.impedance import ImpedanceSettings
from facade_manipulator.compensation.strokes import Strokes
from facade_manipulator.compensation.suspension import SuspensionSettings
from facade_manipulator.kinematics import Geometry, Pose

PERIOD_STEP = 0.5  # s, between the periods of strokes that are tried


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


def stroke_obstacle(
    suspension: SuspensionSettings, press: ImpedanceSettings, strokes: Strokes | None
) -> str:
    """Return why strokes swing the gondola too far and which would not, empty if they do not."""
    if strokes is None or not press.enabled or suspension.mass == 0.0 or _is_calm(
            suspension, press, strokes):
        return ''
    (amplitude, period), periods = strokes, suspension.periods
    x, yaw = suspension.swing(press.force, amplitude, period)
    tried = sorted(
        (PERIOD_STEP * k for k in range(2, 1 + round(2.0 * period / PERIOD_STEP))),
        key=lambda other: abs(other - period))
    calm = next((other for other in tried if _is_calm(
        suspension, press, strokes._replace(period=other))), None)
    return (f'strokes of +-{amplitude:g} m, {period:.1f} s to and fro, may swing the gondola by '
            f'{1e3 * x:.0f} mm and {math.degrees(yaw):.1f} deg, bounds '
            f'{1e3 * press.most_sway:.0f} mm and {math.degrees(press.most_yaw):.1f} deg: its '
            f'periods are {periods[0]:.1f} s along the wall and {periods[2]:.1f} s in yaw; '
            + (f'{calm:g} s to and fro would not' if calm else 'press with less force'))


def _is_calm(
    suspension: SuspensionSettings, press: ImpedanceSettings, strokes: Strokes
) -> bool:
    x, yaw = suspension.swing(press.force, *strokes)
    return x <= press.most_sway and yaw <= press.most_yaw
