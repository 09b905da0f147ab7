"""One design in a dozen numbers: how far the head goes, and how much of that is good."""

from __future__ import annotations

import numpy as np

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.workspace.objectives import Requirements
from facade_manipulator.workspace.requirements import theta_peak
from facade_manipulator.workspace.section import good_section_area, section_area, section_bounds
from facade_manipulator.workspace.volume import measure, union_area


def summarise(
    geometry: Geometry, threshold: float, characteristic_length: float
) -> dict[str, float]:
    """
    Measure one design, in m, m², m² rad and rad; `report.SUMMARY` says what each number is.

    Raises a ParameterError if the workspace is empty.
    """
    design = (geometry.link_length, geometry.platform_half_length, geometry.stroke_length,
              geometry.carriage_gap)
    lower, upper = section_bounds(*design)
    of = measure(geometry, threshold, characteristic_length, theta_nodes=512, y_cells=256)
    if not of.volume > 0.0:
        raise ParameterError(
            f'the workspace is empty: stroke {geometry.stroke_length:g} m and carriage_gap '
            f'{geometry.carriage_gap:g} m leave no pose')
    peak = theta_peak(*(np.array([length]) for length in design[:2]),
                      Requirements(carriage_gap=geometry.carriage_gap))
    return {
        'y_min': float(lower), 'y_max': float(upper), 'theta_max': float(peak[0]),
        'area_section': float(section_area(*design)),
        'good_area_section': float(good_section_area(*design, threshold, characteristic_length)),
        'area_union': union_area(geometry), 'volume': of.volume, 'good_volume': of.good,
        'ratio': of.ratio, 'beyond_parallel_singularity': of.beyond_share,
    }
