"""
What a design is worth, and the link lengths worth most: a dense exact sweep, then a refinement.

Designs are arrays of equal shape. Areas are closed forms; volume and ratio are integrals, done
design by design.

The paper keeps l + b = 700 mm without saying so and gives 352/348; along that line the areas peak
where l = b, and the ratio 1 mm before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import ParameterError
from facade_manipulator.lab.study.requirements import conflict, feasible, margins, Requirements
from facade_manipulator.lab.study.section import Designs, section_area
from facade_manipulator.lab.study.sweep import ignore, Sweep, Tick
from facade_manipulator.lab.study.volume import Workspace

FINE_STEP = 0.001  # of the sweep, as the paper's
COARSE_STEP = 0.005  # where a plane of designs is integrated one by one
_ACTIVE = 2e-4  # a bound nearer than this is active [m]
_RESOLUTION = 1e-6  # m, to which the best design is found
_ABOUT, _CLOSER = np.linspace(-1.0, 1.0, 5), 0.4  # steps at which to look, until nothing is better


class Objective(NamedTuple):
    """A figure of merit: a closed form of arrays of designs, or one of a workspace measured."""

    unit: str
    closed_form: Callable[[Designs, Requirements], np.ndarray] | None = None
    merit: Callable[[Workspace], float] = lambda of: of.volume

    def evaluate(
        self, designs: np.ndarray, measured: Sweep, tick: Tick = ignore
    ) -> np.ndarray:
        """Return the merit of every design, of which l and b are the first dimension."""
        if self.closed_form:
            tick(designs[0].size)
            return self.closed_form(measured.need.lengths(designs), measured.need)
        values = [self.merit(of) for of in measured.of(designs, tick)]
        return np.reshape(values, designs.shape[1:])


OBJECTIVES = {
    'area': Objective('m2', lambda of, need: section_area(of)),  # at θ = 0
    'good_area': Objective('m2', lambda of, need: section_area(
        of, need.threshold, need.characteristic_length)),
    'volume': Objective('m2 rad', merit=lambda of: of.volume - of.beyond),  # before N = 0
    'ratio': Objective('', merit=lambda of: of.ratio if of.volume else 0.0),
}


@dataclass(frozen=True)
class Optimum:
    """The best design found: lengths [m], every figure of merit, what holds it there."""

    objective: str
    link_length: float
    platform_half_length: float
    value: float
    merits: dict[str, float]
    active: tuple[str, ...]
    designs: int


def sweep_size(objective: str, need: Requirements) -> int:
    """Return how many designs the sweep for an objective evaluates."""
    return designs_of(need, _step(_objective(objective), need)).shape[1]


def optimise(
    objective: str, need: Requirements | None = None, tick: Tick = ignore,
    measured: Sweep | None = None,
) -> Optimum:
    """
    Find the link lengths with the greatest of `OBJECTIVES`.

    Who optimises for several gives the same `measured` for all. Raises a ParameterError if the
    objective is unknown, or if no design satisfies the requirements; the message names the
    conflict.
    """
    need = need or Requirements()
    measured = measured or Sweep(need)
    merit = _objective(objective)
    designs = designs_of(need, _step(merit, need))
    allowed = feasible(designs, need)
    if not allowed.any():
        raise conflict(designs, need)
    values = np.full(allowed.shape, -np.inf)
    values[allowed] = merit.evaluate(designs[:, allowed], measured, tick)
    tick(int(np.sum(~allowed)))
    best = np.argmax(values)
    design, value = _refine(merit, measured, designs[:, best], float(values[best]))
    return Optimum(
        objective, float(design[0]), float(design[1]), value,
        {name: float(one.evaluate(design, measured)) for name, one in OBJECTIVES.items()},
        _active(need, design), values.size)


def _objective(name: str) -> Objective:
    if name not in OBJECTIVES:
        raise ParameterError(f'objective = {name!r} is not one of {", ".join(OBJECTIVES)}')
    return OBJECTIVES[name]


def designs_of(need: Requirements, step: float = COARSE_STEP) -> np.ndarray:
    """Return designs, shape (2, n): scattered, or in steps [m] of a line (a given sum) or box."""
    sides = _sides(need)
    points = _scattered(need) if need.designs else np.stack(np.meshgrid(
        *(_steps(*side, step) for side in sides), indexing='ij')).reshape(len(sides), -1)
    return _completed(points, need)


def _completed(points: np.ndarray, need: Requirements) -> np.ndarray:
    """Return designs, shape (2, n), from l and b, or from l alone where their sum is given."""
    return np.stack([points[0], need.length_sum - points[0]]) if need.length_sum else points


def _sides(need: Requirements) -> list[tuple[float, float]]:
    """Return the range of l along the line of a given sum, or those of l and b."""
    if not need.length_sum:
        return [need.link_range, need.platform_range]
    return [(max(need.link_range[0], need.length_sum - need.platform_range[1]),
             min(need.link_range[1], need.length_sum - need.platform_range[0]))]


def _scattered(need: Requirements) -> np.ndarray:
    """Return designs that fill line or box evenly; another seed shifts all of them alike."""
    from scipy.stats import qmc

    lower, upper = np.transpose(_sides(need))
    shift = np.random.default_rng(need.seed).random(len(lower))
    shares = (qmc.Halton(len(lower), scramble=False).random(need.designs) + shift) % 1.0
    return (lower + shares * (upper - lower)).T


def _step(merit: Objective, need: Requirements) -> float:
    """Return about how far neighbouring designs of the sweep are from each other [m]."""
    if need.designs:
        sides = _sides(need)
        return max(upper - lower for lower, upper in sides) / need.designs ** (1.0 / len(sides))
    closed_form = merit.closed_form and not need.min_theta
    return FINE_STEP if need.length_sum or closed_form else COARSE_STEP


def _steps(lower: float, upper: float, step: float) -> np.ndarray:
    """Return lengths from `lower` to `upper`, both included."""
    count = max(1, round((upper - lower) / step))
    return np.unique(np.round(np.linspace(lower, upper, count + 1), 9))


def _refine(
    merit: Objective, measured: Sweep, design: np.ndarray, value: float
) -> tuple[np.ndarray, float]:
    """Look about the sweep's best, ever closer; keep it where nothing is better."""
    sides, step = np.array(_sides(measured.need)), _step(merit, measured.need)
    while step > _RESOLUTION:
        about = np.stack(np.meshgrid(*(step * _ABOUT + at for at in design[:len(sides)])))
        designs = _completed(np.clip(
            about.reshape(len(sides), -1), sides[:, :1], sides[:, 1:]), measured.need)
        designs = designs[:, feasible(designs, measured.need)]
        values = merit.evaluate(designs, measured)
        best = int(np.argmax(values))
        if values[best] > value:
            design, value = designs[:, best], float(values[best])
        else:
            step *= _CLOSER
    return design, value


def _active(need: Requirements, design: np.ndarray) -> tuple[str, ...]:
    """Name what the optimum leans on."""
    length, half = design
    edges = {
        f'l >= {need.link_range[0]:g} m': length - need.link_range[0],
        f'l <= {need.link_range[1]:g} m': need.link_range[1] - length,
        f'b >= {need.platform_range[0]:g} m': half - need.platform_range[0],
        f'b <= {need.platform_range[1]:g} m': need.platform_range[1] - half,
        'order of the carriages, l = b - gap': abs(length - half + need.carriage_gap),
        'stroke, Q = 2 b': abs(need.stroke_length - 2.0 * half),
    }
    names = [name for name, distance in edges.items() if distance <= _ACTIVE]
    if need.length_sum:
        names.insert(0, f'l + b = {need.length_sum:g} m')
    return (*names, *(
        requirement.words(need) for requirement, margin in margins(design, need).items()
        if margin <= requirement.tolerance))
