"""
Where the determinants vanish: the far edge det A = 0 and the locus det B = 0 the paper misses.

det A = 4 s1 s2 vanishes where a link stands upright, y = l − b |sin θ| (case c of Figure 7).
det B = −4 b N vanishes where the lines of both links and the rail's parallel through P meet in
one point. Of Figure 7, case a is a point of it for l < b; cases b and d are regular, one entry
of J is zero there and neither determinant.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.lab.study.reach import number_at
from facade_manipulator.lab.study.volume import bisect, measure

SAMPLES = 100


class Configuration(NamedTuple):
    """A configuration worth drawing: name, what it shows, geometry, pose."""

    name: str
    note: str
    geometry: Geometry
    pose: Pose


def serial_curve(geometry: Geometry, theta: np.ndarray) -> np.ndarray:
    """Return the y of det A = 0 at every θ [m]; NaN where the links do not reach the platform."""
    y = geometry.link_length - geometry.platform_half_length * np.abs(np.sin(theta))
    return np.where(y > 0.0, y, np.nan)


def parallel_curves(geometry: Geometry, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the y > 0 of det B = 0 at every θ [m]; NaN where there is none.

    The first curve bounds N > 0 towards the rail. The second bounds it towards the façade, near
    the far edge, at the angles where the platform's rear half is behind the rail.
    """
    theta = np.abs(theta)
    edge = np.where(np.cos(theta) > 0.0, serial_curve(geometry, theta), np.nan)

    def number(y: np.ndarray) -> np.ndarray:
        return number_at(geometry, y, theta)

    y = edge * np.linspace(0.0, 1.0, SAMPLES + 1)[:, None]
    numbers = number(y)
    highest = np.argmax(np.nan_to_num(numbers, nan=-np.inf), axis=0)[None]
    top = np.take_along_axis(y, highest, axis=0)[0]
    regular = np.take_along_axis(numbers, highest, axis=0)[0] > 0.0
    lower, upper = (
        np.where(regular & (numbers[end] < 0.0), bisect(number, y[end], top), np.nan)
        for end in (0, -1))
    return lower, upper


def beyond_share(geometry: Geometry) -> float:
    """Measure the share of the workspace by reach, order, gap and stroke that has N ≤ 0."""
    return measure(geometry, 0.0, theta_nodes=512, y_cells=256).beyond_share


def configurations() -> tuple[Configuration, ...]:
    """Return the cases of Figure 7 of the paper and the singularity it misses."""
    short = Geometry(0.25, 0.45, carriage_gap=0.0)
    in_line = np.radians(15.0)
    y_in_line = (short.platform_half_length - short.link_length) * float(np.sin(in_line))
    turned = np.radians(16.0)
    return (
        Configuration('a) folded', 'det B = 0, only for l < b', short, Pose(0.0, 0.0, 0.0)),
        Configuration('b) left link in line', 'regular, beyond N = 0', short,
                      Pose(0.0, y_in_line, in_line)),
        Configuration('c) stretched', 'det A = 0, the far edge', short,
                      Pose(0.0, short.link_length, 0.0)),
        Configuration('d) right link in line', 'regular, beyond N = 0', short,
                      Pose(0.0, y_in_line, -in_line)),
        Configuration('e) lines of force meet', 'det B = 0, not in the paper', short,
                      Pose(0.0, float(parallel_curves(short, turned)[0][0]), float(turned))),
    )
