"""
Margins of the requirements over arrays of designs, and the message where they conflict.

A margin is what a design has beyond what is asked for; below zero it fails.
"""

from __future__ import annotations

from collections.abc import Callable
import itertools
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import ParameterError
from facade_manipulator.workspace.limits import theta_limits
from facade_manipulator.workspace.objectives import Requirements
from facade_manipulator.workspace.section import good_section_bounds

_SAMPLES = 64  # of y, to find the peaks of θ_max
_NEAR, _REFINEMENTS = 15, 5  # of y about a peak, five times as close at each refinement
_BLOCK = 512  # designs at once


class Requirement(NamedTuple):
    """One requirement: what is asked for, in words too, and what a design reaches."""

    name: str
    unit: str
    words: Callable[[Requirements], str]  # empty where nothing is asked for
    reached: Callable[[np.ndarray, np.ndarray, Requirements], np.ndarray]
    tolerance: float  # a margin below it is active

    def asked(self, need: Requirements) -> float:
        """Return the least that a design must reach."""
        return getattr(need, self.name)


def y_travel(length: np.ndarray, half: np.ndarray, need: Requirements) -> np.ndarray:
    """Return the range of y at θ = 0 whose index is at least `min_conditioning` [m]."""
    lower, upper = good_section_bounds(
        length, half, need.stroke_length, need.carriage_gap, need.min_conditioning,
        need.characteristic_length)
    return upper - lower


def theta_peak(length: np.ndarray, half: np.ndarray, need: Requirements) -> np.ndarray:
    """Return the greatest |θ| that is reachable at some y before N = 0 [rad]."""
    flat_length, flat_half = np.ravel(length), np.ravel(half)
    peaks = [
        _theta_peak(flat_length[start:start + _BLOCK, None], flat_half[start:start + _BLOCK, None],
                    need.carriage_gap)
        for start in range(0, flat_length.size, _BLOCK)]
    return np.concatenate(peaks).reshape(np.shape(length))


def _words_of_travel(need: Requirements) -> str:
    """Conditioning alone asks for a y at which it holds."""
    return ' with '.join(
        f'{name} = {asked:.4g}{unit}' for name, asked, unit in (
            ('min_y_travel', need.min_y_travel, ' m'),
            ('min_conditioning', need.min_conditioning, '')) if asked)


REQUIREMENTS = (
    Requirement('min_y_travel', 'm', _words_of_travel, y_travel, 1e-4),
    Requirement(
        'min_theta', 'rad',
        lambda need: f'min_theta = {need.min_theta:.4g} rad' if need.min_theta else '',
        theta_peak, 1e-3),
)


def margins(
    length: np.ndarray, half: np.ndarray, need: Requirements
) -> dict[str, np.ndarray]:
    """Return the margin of every requirement that asks for anything, by name."""
    return {
        requirement.name: requirement.reached(length, half, need) - requirement.asked(need)
        for requirement in REQUIREMENTS if requirement.words(need)}


def feasible(of: dict[str, np.ndarray], length: np.ndarray) -> np.ndarray:
    """Whether every margin is there; an index asked for must hold at some y at least."""
    allowed = np.ones(np.shape(length), bool)
    for name, margin in of.items():
        allowed &= margin > 0.0 if name == 'min_y_travel' else margin >= 0.0
    return allowed


def conflict(
    of: dict[str, np.ndarray], length: np.ndarray, half: np.ndarray, need: Requirements
) -> ParameterError:
    """Say which requirements cannot be met: one alone, two together, or all of them."""
    stated = [requirement for requirement in REQUIREMENTS if requirement.name in of]
    for requirement in stated:
        best = np.argmax(of[requirement.name])
        margin = of[requirement.name].flat[best]
        if margin < 0.0 or (margin == 0.0 and requirement.asked(need) == 0.0):
            return ParameterError(_alone(
                requirement, margin, length.flat[best], half.flat[best], need))
    for one, other in itertools.combinations(stated, 2):
        if not feasible({one.name: of[one.name], other.name: of[other.name]}, length).any():
            return ParameterError(
                f'{one.words(need)} and {other.words(need)} exclude each other: no design '
                'of the box satisfies both')
    return ParameterError('the requirements exclude each other')


def _alone(
    requirement: Requirement, margin: float, length: float, half: float, need: Requirements
) -> str:
    asked = requirement.asked(need)
    most = (f'the most is {asked + margin:.4g} {requirement.unit}, at l = {length:.3f} m, '
            f'b = {half:.3f} m') if asked else (
        f'no design reaches it at theta = 0 in units of {need.characteristic_length:g} m')
    return f'{requirement.words(need)} conflicts with the box and the sum of the lengths: {most}'


def _theta_peak(length: np.ndarray, half: np.ndarray, gap: float) -> np.ndarray:
    """
    Return the peak of θ_max(y) of a column of designs.

    Links shorter than b have two: where the order meets N = 0, and where it meets the reach.
    """
    share = np.linspace(0.0, 1.0, _SAMPLES)[1:-1]
    theta = theta_limits(length, half, gap, share * length)
    beside = np.pad(theta, ((0, 0), (1, 1)))
    local = (theta >= beside[:, :-2]) & (theta >= beside[:, 2:])
    best = np.argsort(np.where(local, theta, -1.0), axis=1)[:, -2:]
    return np.maximum(*(
        _refined_peak(length, half, gap, share[best[:, place], None]) for place in (0, 1)))


def _refined_peak(
    length: np.ndarray, half: np.ndarray, gap: float, share: np.ndarray
) -> np.ndarray:
    """Return the greatest θ_max near a share of l, by ever closer samples."""
    step = 1.0 / _SAMPLES
    for _ in range(_REFINEMENTS):
        near = np.clip(share + step * np.linspace(-1.5, 1.5, _NEAR), 1e-6, 1.0 - 1e-6)
        theta = theta_limits(length, half, gap, near * length)
        share = np.take_along_axis(near, np.argmax(theta, axis=1)[:, None], axis=1)
        step *= 3.0 / _NEAR
    return theta.max(axis=1)
