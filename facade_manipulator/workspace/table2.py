"""
Table 2 of the paper, reproduced beside its figures.

The ratio column comes out to its three digits: lengths in mm, an index of 0.001 or more is good,
every grid pose counts that reach and the carriages' order allow. The paper states neither the
stroke nor what its areas are, and no natural definition with one common stroke gives them: two
named areas stand beside the paper's, tuned to nothing.
"""

from __future__ import annotations

from typing import NamedTuple

from facade_manipulator.kinematics import Geometry
from facade_manipulator.workspace.gcw import count_poses
from facade_manipulator.workspace.section import section_area
from facade_manipulator.workspace.volume import union_area

STROKE_LENGTH = 1.005  # with it the ratios round to the paper's; 1.0 moves them by 0.001


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


def table2(stroke_length: float = STROKE_LENGTH) -> list[dict]:
    """
    Compute every row of Table 2 for a common Q [m], as JSON wants it: lengths in m, areas in m².

    References
    ----------
    Table 2 and section IV of the paper.

    """
    return [_row(paper, stroke_length) for paper in PAPER]


def _row(paper: PaperRow, stroke_length: float) -> dict:
    length, half = paper.link_length, paper.platform_half_length
    geometry = case_geometry(length, half, stroke_length)
    return {
        'l': length, 'b': half, 'ratio': count_poses(geometry).ratio,
        'area_section': float(section_area(length, half, stroke_length, 0.0)),
        'area_union': union_area(geometry),
        'paper': {'area': paper.area, 'ratio': paper.ratio, 'good_area': paper.good_area}}
