"""
Singular loci: far edge det A = 0; det B = 0 inside the workspace, missing in the paper.

det A = 4 s1 s2 vanishes where a link is square to the rail, y = l − b |sin θ| (case c of
Figure 7). det B = −4 b N vanishes where the lines of both links and the parallel to the rail
through P meet in one point. Case a of Figure 7 is such a point for l < b. Cases b and d are
regular: one entry of J is zero there, but neither determinant.
"""

from __future__ import annotations

from math import radians, sin

import numpy as np

from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.kinematics.maps import number_at
from facade_manipulator.study.workspace_metrics import bisect


def serial_curve(geometry: Geometry, theta: np.ndarray) -> np.ndarray:
    """Return the y with det A = 0 for every θ [m]; NaN if the links do not reach the platform."""
    y = geometry.link_length - geometry.platform_half_length * np.abs(np.sin(theta))
    return np.where(y > 0.0, y, np.nan)


SEARCH_SAMPLES = 100  # of y, to find a regular pose between both curves


def parallel_curves(
    geometry: Geometry, theta: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return all y > 0 with det B = 0 for every θ [m], exact to rounding; NaN if none exists.

    The first curve bounds N > 0 towards the rail. The second curve bounds N > 0 towards the
    façade, near the far edge, at angles where one joint of the platform is behind the rail.
    """
    theta = np.abs(theta)
    edge = np.where(np.cos(theta) > 0.0, serial_curve(geometry, theta), np.nan)
    y = edge * np.linspace(0.0, 1.0, SEARCH_SAMPLES + 1)[:, None]
    numbers = number_at(geometry, y, theta)

    # the sample with the largest N is between both curves
    highest = np.argmax(np.nan_to_num(numbers, nan=-np.inf), axis=0)[None]
    top = np.take_along_axis(y, highest, axis=0)[0]
    is_regular = np.take_along_axis(numbers, highest, axis=0)[0] > 0.0

    def number(at: np.ndarray) -> np.ndarray:
        return number_at(geometry, at, theta)

    def root(end: int) -> np.ndarray:
        found = bisect(number, y[end], top)
        return np.where(is_regular & (numbers[end] < 0.0), found, np.nan)

    return root(0), root(-1)


def configurations(geometry: Geometry) -> dict[str, Pose]:
    """Return the cases of Figure 7 for l < b, and the singularity missing in the paper."""
    length = geometry.link_length
    half = geometry.platform_half_length
    in_line = radians(15.0)
    turned = radians(16.0)
    y_in_line = (half - length) * sin(in_line)
    (y_singular,), _ = parallel_curves(geometry, np.array([turned]))

    folded = Pose(0.0, 0.0, 0.0)
    left = Pose(0.0, y_in_line, in_line)
    stretched = Pose(0.0, length, 0.0)
    right = Pose(0.0, y_in_line, -in_line)
    meeting = Pose(0.0, float(y_singular), turned)
    return {
        'a) folded\ndet B = 0, only for l < b': folded,
        'b) left link in line\nregular, beyond N = 0': left,
        'c) stretched\ndet A = 0, the far edge': stretched,
        'd) right link in line\nregular, beyond N = 0': right,
        'e) lines of force meet\ndet B = 0, not in the paper': meeting,
    }
