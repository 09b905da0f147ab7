"""
What a design can be evaluated by, and what it must satisfy: both over arrays of (l, b).

Designs are arrays of equal shape. Areas are closed forms; volume and ratio are integrals, done
design by design.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.parameters import parameter, settings
from facade_manipulator.workspace.section import good_section_area, section_area
from facade_manipulator.workspace.volume import measure, Workspace

THETA_NODES, Y_CELLS = 512, 64  # the ratio to 2e-4, the volume far better

Tick = Callable[[int], None]  # called with the number of designs done


@settings
class Requirements:
    """What every design must satisfy, and what is called good."""

    link_range: tuple[float, float] = parameter(
        (0.150, 0.400), 'Least and greatest l (Table 1)', unit='m', minimum=1e-3, maximum=100.0)
    platform_range: tuple[float, float] = parameter(
        (0.300, 0.550), 'Least and greatest b (Table 1)', unit='m', minimum=1e-3, maximum=100.0)
    length_sum: float = parameter(
        0.7, 'l + b; 0 leaves it free', unit='m', minimum=0.0, maximum=200.0)
    stroke_length: float = parameter(1.0, 'Stroke Q', unit='m', minimum=1e-3, maximum=200.0)
    carriage_gap: float = parameter(
        0.0, 'Least distance of neighbouring carriages', unit='m', minimum=0.0, maximum=100.0)
    min_y_travel: float = parameter(
        0.0, 'Least range of y at θ = 0', unit='m', minimum=0.0, maximum=100.0)
    min_theta: float = parameter(
        0.0, 'Least |θ| reachable at some y before N = 0', unit='rad', minimum=0.0, maximum=1.6)
    min_conditioning: float = parameter(
        0.0, 'Least index over the range of y asked for', minimum=0.0, maximum=1.0)
    threshold: float = parameter(
        0.001, 'Least index of a good pose', minimum=0.0, maximum=1.0)
    characteristic_length: float = parameter(
        0.001, 'Unit of length of the index', unit='m', minimum=1e-9, maximum=1e3)

    def __post_init__(self) -> None:
        for name in ('link_range', 'platform_range'):
            lower, upper = getattr(self, name)
            if lower > upper:
                raise ParameterError(f'{name} = ({lower:g}, {upper:g}) m is empty')
        least = self.link_range[0] + self.platform_range[0]
        greatest = self.link_range[1] + self.platform_range[1]
        if self.length_sum and not least <= self.length_sum <= greatest:
            raise ParameterError(
                f'length_sum = {self.length_sum:g} m conflicts with link_range and '
                f'platform_range, which allow {least:g} m to {greatest:g} m')
        if 2.0 * self.carriage_gap >= self.stroke_length:
            raise ParameterError(
                f'carriage_gap = {self.carriage_gap:g} m leaves no room for three carriages '
                f'on a stroke of {self.stroke_length:g} m')
        if self.carriage_gap >= self.platform_range[0]:
            raise ParameterError(
                f'carriage_gap = {self.carriage_gap:g} m is not below the least b of '
                f'{self.platform_range[0]:g} m')

    def geometry(self, length: float, half: float) -> Geometry:
        """Return a design as a geometry, its stroke about zero."""
        return Geometry(
            float(length), float(half),
            (-0.5 * self.stroke_length, 0.5 * self.stroke_length), self.carriage_gap)


class Objective(NamedTuple):
    """A figure of merit: a closed form of arrays of designs, or one of a workspace measured."""

    description: str
    unit: str
    closed_form: Callable[[np.ndarray, np.ndarray, Requirements], np.ndarray] | None = None
    merit: Callable[[Workspace], float] | None = None

    def evaluate(
        self, length: np.ndarray, half: np.ndarray, need: Requirements,
        tick: Tick = lambda count: None,
    ) -> np.ndarray:
        """Return the merit of every design, of their shape."""
        if self.closed_form:
            tick(length.size)
            return self.closed_form(length, half, need)
        values = np.empty(length.shape)
        for place in np.ndindex(length.shape):
            values[place] = self.merit(measure(
                need.geometry(length[place], half[place]), need.threshold,
                need.characteristic_length, THETA_NODES, Y_CELLS))
            tick(1)
        return values


OBJECTIVES = {
    'area': Objective(
        'area at theta = 0', 'm2', lambda length, half, need: section_area(
            length, half, need.stroke_length, need.carriage_gap)),
    'good_area': Objective(
        'area at theta = 0 with a good index', 'm2', lambda length, half, need: good_section_area(
            length, half, need.stroke_length, need.carriage_gap, need.threshold,
            need.characteristic_length)),
    'volume': Objective('volume over x, y and theta before N = 0', 'm2 rad',
                        merit=lambda of: of.volume - of.beyond),
    'ratio': Objective('good share of the volume', '',
                       merit=lambda of: of.ratio if of.volume else 0.0),
}
