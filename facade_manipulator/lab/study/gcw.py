"""
Good-condition workspace (section IV of the paper): counts over a grid of poses, and shares.

The paper counts grid points (x, y, θ). At fixed (y, θ) those within the x-interval are counted
in closed form, so no grid of x exists; the counts are those of brute force to the last pose.

The ratios of Table 2 come out to their three digits: lengths in mm, an index of 0.001 or more is
good, every grid pose counts that reach and the carriages' order allow. The paper states neither
the stroke nor what its areas are, and no natural definition with one common stroke gives them: two
named areas stand beside the paper's, tuned to nothing.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from facade_manipulator.kinematics import Geometry, pose_map
from facade_manipulator.lab.study.section import section_area
from facade_manipulator.lab.study.volume import theta_end, union_area

ON_GRID = 1e-9  # of a spacing: an end of the interval that is a grid point but for rounding


class Grid(NamedTuple):
    """Spacing of the poses that are counted: x and y [m], θ [rad]; x = 0 and θ = 0 are on it."""

    x: float = 0.001
    y: float = 0.001
    theta: float = float(np.radians(1.0))


PAPER_GRID = Grid()
PAPER_THRESHOLD = 0.001
PAPER_CHARACTERISTIC_LENGTH = 0.001  # the paper's lengths are in mm
STROKE_LENGTH = 1.005  # with it the ratios round to the paper's; 1.0 moves them by 0.001


class PoseCount(NamedTuple):
    """How many grid poses are reachable, how many of them good, how many beyond N = 0."""

    total: int
    good: int
    beyond: int

    @property
    def ratio(self) -> float:
        """Share of the good poses; NaN if none is reachable."""
        return self.good / self.total if self.total else float('nan')


def count_poses(
    geometry: Geometry, grid: Grid = PAPER_GRID, threshold: float = PAPER_THRESHOLD,
    characteristic_length: float = PAPER_CHARACTERISTIC_LENGTH,
) -> PoseCount:
    """
    Count the grid poses that reach, order, gap and stroke allow, with y > 0, as brute force would.

    A pose is good from an index of `threshold` on, of which the characteristic length [m] is the
    unit of length. Poses beyond N = 0 are part of the total.
    """
    turns = int(theta_end(geometry) / grid.theta)
    of = pose_map(geometry, grid_y(geometry, grid)[:, None],
                  grid.theta * np.arange(-turns, turns + 1), characteristic_length)
    first, last = np.ceil(of.lower / grid.x - ON_GRID), np.floor(of.upper / grid.x + ON_GRID)
    count = np.nan_to_num(np.maximum(0.0, last - first + 1.0))
    good, beyond = of.conditioning >= threshold, of.number <= 0.0
    return PoseCount(*(int(count[of_them].sum()) for of_them in (..., good, beyond)))


def grid_y(geometry: Geometry, grid: Grid) -> np.ndarray:
    """Distances y of the grid, from the first spacing to the links' length [m]."""
    count = int(geometry.link_length / grid.y + 1e-9)
    # Rounded, so that 352 times 0.001 is the link's 0.352 and not a bit beside it.
    return np.round(np.arange(1, count + 1) * grid.y, 12)


class PaperRow(NamedTuple):
    """A row of Table 2 as printed: lengths [m], areas [m²], ratio."""

    link_length: float
    platform_half_length: float
    area: float
    ratio: float
    good_area: float


PAPER = (
    PaperRow(0.150, 0.550, 0.025, 0.788, 0.020),
    PaperRow(0.200, 0.500, 0.080, 0.803, 0.064),
    PaperRow(0.250, 0.450, 0.153, 0.834, 0.128),
    PaperRow(0.300, 0.400, 0.251, 0.870, 0.217),
    PaperRow(0.352, 0.348, 0.328, 0.986, 0.323),
)


def case_geometry(length: float, half: float, stroke_length: float = STROKE_LENGTH) -> Geometry:
    """Return the geometry of a case: carriages without width, the stroke about zero."""
    return Geometry(length, half, (-0.5 * stroke_length, 0.5 * stroke_length), 0.0)


def table2(stroke_length: float = STROKE_LENGTH) -> list[dict[str, Any]]:
    """Compute every row of Table 2 for a common Q [m], as JSON wants it, in m and m²."""
    return [_row(paper, stroke_length) for paper in PAPER]


def _row(paper: PaperRow, stroke_length: float) -> dict[str, Any]:
    length, half = paper.link_length, paper.platform_half_length
    geometry = case_geometry(length, half, stroke_length)
    ratio = count_poses(geometry).ratio
    section = float(section_area(geometry))
    return {
        'l': length, 'b': half, 'ratio': ratio, 'area_section': section,
        'good_area_section': ratio * section,  # as the paper: its area times its ratio
        'area_union': union_area(geometry),
        'paper': {'area': paper.area, 'ratio': paper.ratio, 'good_area': paper.good_area}}
