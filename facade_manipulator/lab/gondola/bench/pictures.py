"""
The picture of the force that a gondola can press with.

Only the bench imports this module, and matplotlib with it.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from facade_manipulator.compensation import SuspensionSettings
from facade_manipulator.lab.gondola.pictures import label, new_figure, plain_ticks, save, WITHOUT

PUSH_BACK, YAW, BESIDE = 0.1, 5.0, 0.1  # m, degrees, m: what depth and width allow
GUIDES = ((0.0, 0.0), (60.0, 0.6), (200.0, 0.6), (600.0, 0.6))  # N/m, m
DESIRED = 30.0  # N


def draw_forces(path: Path) -> None:
    """Draw the most that a gondola can press with against the length of its cables."""
    figure = new_figure(8, 5, f'500 kg: pushed back by {1e3 * PUSH_BACK:g} mm or turned by '
                        f'{YAW:g}° at {1e3 * BESIDE:g} mm beside the middle')
    panel, lengths = figure.add_subplot(), np.geomspace(5.0, 150.0, 100).tolist()
    for stiffness, lever in GUIDES:
        panel.loglog(lengths, [
            _most_force(SuspensionSettings(mass=500.0, cable_length=length,
                                           guide_stiffness=stiffness, guide_lever=lever))
            for length in lengths],
            label=f'guide {stiffness:g} N/m at ±{lever:g} m' if stiffness else 'no guide')
    plain_ticks(panel.xaxis)
    plain_ticks(panel.yaxis)
    panel.axhline(DESIRED, color=WITHOUT, ls='--', lw=1.0)
    panel.legend()
    label(panel, 'free length of the cables [m]', 'force on the wall [N]')
    save(figure, path)


def _most_force(suspension: SuspensionSettings) -> float:
    return min(PUSH_BACK / suspension.push_back(1.0),
               math.radians(YAW) / suspension.yaw(1.0, BESIDE))
