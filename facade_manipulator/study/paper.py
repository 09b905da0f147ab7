"""
Tables 1 and 2 of the paper.

The ratios of Table 2 agree with the paper to its three digits under three assumptions. Lengths are
in mm; an index of at least 0.001 is good; the poses are on a grid of 1 mm and 1°, limited by reach
and the order of the carriages. At each (y, θ) of this grid the width of the x-interval is the
weight, which needs no grid of x.

The paper states neither the stroke nor the definition of its areas, and no natural definition with
one common stroke reproduces these areas. Two areas with a stated definition are printed beside
those of the paper; their definition is not tuned.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from facade_manipulator.kinematics import Geometry
from facade_manipulator.kinematics.maps import pose_map
from facade_manipulator.study.workspace_metrics import (
    Good,
    PAPER_GOOD,
    section_area,
    union_area,
)

LINK_RANGE = (0.150, 0.400)  # Table 1: l and b [m]
PLATFORM_RANGE = (0.300, 0.550)
LENGTH_SUM = 0.7  # m: l + b of every case of the paper, which does not state it
# m: the ratios round to those of the paper; 1.0 moves them by 0.001
STROKE_LENGTH = 1.005


class Case(NamedTuple):
    """A row of Table 2 as printed in the paper: lengths [m], areas [m²], ratio."""

    link_length: float
    platform_half_length: float
    area: float
    ratio: float
    good_area: float


CASES = (
    Case(0.150, 0.550, 0.025, 0.788, 0.020),
    Case(0.200, 0.500, 0.080, 0.803, 0.064),
    Case(0.250, 0.450, 0.153, 0.834, 0.128),
    Case(0.300, 0.400, 0.251, 0.870, 0.217),
    Case(0.352, 0.348, 0.328, 0.986, 0.323),
)


def design(
    length: float, half: float, stroke_length: float = STROKE_LENGTH, gap: float = 0.0
) -> Geometry:
    """Return a design with a stroke centred on zero; by default, carriages have no width [m]."""
    stroke = (-0.5 * stroke_length, 0.5 * stroke_length)
    return Geometry(length, half, stroke, gap)


GRID_STEP = 0.001  # m, of the grid of y
GRID_TURN = float(np.radians(1.0))  # of the grid of θ


def ratio_on_grid(geometry: Geometry, good: Good = PAPER_GOOD) -> float:
    """Return the share of good poses on the grid of the paper; NaN for an empty workspace."""
    # Rounded, so that 352 times 0.001 is exactly the length of the link, 0.352.
    y = np.round(np.arange(GRID_STEP, geometry.link_length + 1e-9, GRID_STEP), 12)[
        :, None
    ]
    theta = GRID_TURN * np.arange(-90, 91)
    at = pose_map(geometry, y, theta, good.characteristic_length)
    total = at.width.sum()
    if not total:
        return np.nan
    is_good = at.conditioning >= good.threshold
    return float(at.width[is_good].sum() / total)


def table2(stroke_length: float = STROKE_LENGTH) -> list[dict[str, Any]]:
    """Return every row of Table 2 for a common stroke [m], for JSON, in m and m²."""
    rows = []
    for length, half, *printed in CASES:
        geometry = design(length, half, stroke_length)
        ratio = ratio_on_grid(geometry)
        section = section_area(geometry)
        row = {
            'l': length,
            'b': half,
            'ratio': ratio,
            'area_section': section,
            # the paper multiplies its area by its ratio
            'good_area_section': ratio * section,
            'area_union': union_area(geometry),
            'paper': dict(zip(Case._fields[2:], printed, strict=True)),
        }
        rows.append(row)
    return rows
