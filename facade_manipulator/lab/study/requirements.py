"""
What a design must satisfy, how far arrays of designs do, and the message where that conflicts.

A margin is what a design has beyond what is asked for; below zero it fails.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.lab.study.reach import theta_limits
from facade_manipulator.lab.study.section import Designs, Lengths, section_bounds
from facade_manipulator.parameters import parameter, settings

_SAMPLES = 64  # of y, to find the peaks of θ_max
_NEAR, _REFINEMENTS = 15, 5  # of y about a peak, five times as close at each refinement
ROUNDING = 1e-9  # m
_BLOCK = 512  # designs at once


@settings
class Requirements:
    """What every design must satisfy, and what is called good."""

    link_range: tuple[float, float] = parameter(
        'Least and greatest l (Table 1)', default=(0.150, 0.400), unit='m', minimum=1e-3,
        maximum=100.0)
    platform_range: tuple[float, float] = parameter(
        'Least and greatest b (Table 1)', default=(0.300, 0.550), unit='m', minimum=1e-3,
        maximum=100.0)
    length_sum: float = parameter(
        'l + b; 0 leaves it free', default=0.7, unit='m', minimum=0.0, maximum=200.0)
    stroke_length: float = parameter(
        'Stroke Q', default=1.0, unit='m', minimum=1e-3, maximum=200.0)
    carriage_gap: float = parameter(
        'Least distance of neighbouring carriages: none in the paper, 0.02 in the machine',
        default=0.0, unit='m', minimum=0.0, maximum=100.0)
    min_y_travel: float = parameter(
        'Least range of y at θ = 0', default=0.0, unit='m', minimum=0.0, maximum=100.0)
    min_theta: float = parameter(
        'Least |θ| reachable at some y before N = 0', default=0.0, unit='rad', minimum=0.0,
        maximum=1.6)
    min_difference: float = parameter(
        'Least l - b: at 0 nothing of the workspace lies beyond N = 0; -1 leaves it free',
        default=0.0, unit='m', minimum=-1.0, maximum=100.0)
    threshold: float = parameter(
        'Least index of a good pose', default=0.001, minimum=0.0, maximum=1.0)
    characteristic_length: float = parameter(
        'Unit of length of the index: 0.001 in the paper, 1 shows weak poses at the rail',
        default=0.001, unit='m', minimum=1e-9, maximum=1e3)
    designs: int = parameter(
        'Designs of the sweep, scattered over the box; 0: in even steps', default=0, minimum=0,
        maximum=10**7)
    seed: int = parameter('Seed of their places', default=1, minimum=0, maximum=2**31 - 1)

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
        self.geometry(self.link_range[0], self.platform_range[0])  # has rules of its own

    def geometry(self, length: float, half: float) -> Geometry:
        """Return a design as a geometry, its stroke about zero."""
        return Geometry(
            float(length), float(half),
            (-0.5 * self.stroke_length, 0.5 * self.stroke_length), self.carriage_gap)

    def lengths(self, designs: np.ndarray) -> Designs:
        """Return the lengths of designs, of which l and b [m] are the first dimension."""
        length, half = designs
        return Designs(length, half, self.stroke_length, self.carriage_gap)


class Requirement(NamedTuple):
    """One requirement: what is asked for, and what a design reaches."""

    name: str
    unit: str
    reached: Callable[[Designs], np.ndarray]
    tolerance: float  # a margin below it is active
    off: float = 0.0  # what asks for nothing

    def asked(self, need: Requirements) -> float:
        """Return the least that a design must reach."""
        return getattr(need, self.name)

    def words(self, need: Requirements) -> str:
        """Say what is asked for."""
        return f'{self.name} = {self.asked(need):.4g} {self.unit}'


def theta_peak(of: Lengths) -> np.ndarray:
    """Return the greatest |θ| that is reachable at some y before N = 0 [rad]."""
    length, half = np.ravel(of.link_length)[:, None], np.ravel(of.platform_half_length)[:, None]
    blocks = [slice(start, start + _BLOCK) for start in range(0, len(length), _BLOCK)]
    return np.concatenate([
        _theta_peak(Designs(length[block], half[block], of.stroke_length, of.carriage_gap))
        for block in blocks]).reshape(np.shape(of.link_length))


REQUIREMENTS = (
    Requirement('min_y_travel', 'm', lambda of: -np.subtract(*section_bounds(of)), 1e-4),
    Requirement('min_theta', 'rad', theta_peak, 1e-3),
    Requirement('min_difference', 'm',
                lambda of: of.link_length - of.platform_half_length + ROUNDING, 1e-4, off=-1.0),
)


def margins(designs: np.ndarray, need: Requirements) -> dict[Requirement, np.ndarray]:
    """Return the margins of designs by every requirement that asks for anything."""
    of = need.lengths(designs)
    return {requirement: requirement.reached(of) - requirement.asked(need)
            for requirement in REQUIREMENTS if requirement.asked(need) != requirement.off}


def feasible(designs: np.ndarray, need: Requirements) -> np.ndarray:
    """Return whether designs have every margin."""
    allowed: np.ndarray = np.ones(designs.shape[1:], bool)
    for margin in margins(designs, need).values():
        allowed &= margin >= 0.0
    return allowed


def conflict(designs: np.ndarray, need: Requirements) -> ParameterError:
    """Say which requirement cannot be met alone, or that two cannot be met together."""
    found = margins(designs, need)
    for requirement, margin in found.items():
        best = np.argmax(margin)
        if margin[best] < 0.0:
            length, half = designs[:, best]
            return ParameterError(
                f'{requirement.words(need)} conflicts with the box and the sum of the lengths: '
                f'the most is {requirement.asked(need) + margin[best]:.4g} {requirement.unit}, at '
                f'l = {length:.3f} m, b = {half:.3f} m')
    return ParameterError(f'{" and ".join(one.words(need) for one in found)} exclude each '
                          'other: no design of the box satisfies both')


def _theta_peak(of: Designs) -> np.ndarray:
    """
    Return the peak of θ_max(y) of a column of designs.

    Links shorter than b have two: where the order meets N = 0, and where it meets the reach. Ever
    closer samples are taken about both.
    """
    share = np.linspace(0.0, 1.0, _SAMPLES)[1:-1]
    theta = theta_limits(of, share * of.link_length)
    beside = np.pad(theta, ((0, 0), (1, 1)))
    local = (theta >= beside[:, :-2]) & (theta >= beside[:, 2:])
    best = np.argsort(np.where(local, theta, -1.0), axis=1)[:, -2:]
    share, step = share[best][..., None], 1.0 / _SAMPLES
    of = of._replace(link_length=of.link_length[..., None],
                     platform_half_length=of.platform_half_length[..., None])
    for _ in range(_REFINEMENTS):
        near = np.clip(share + step * np.linspace(-1.5, 1.5, _NEAR), 1e-6, 1.0 - 1e-6)
        theta = theta_limits(of, near * of.link_length)
        share = np.take_along_axis(near, np.argmax(theta, axis=-1, keepdims=True), axis=-1)
        step *= 3.0 / _NEAR
    return theta.max(axis=(1, 2))
