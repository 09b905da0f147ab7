"""
Machines that do what is asked, and those of them of which none other is better in all respects.

A design is l and b. It stands where its motors need the least power, has the rail that the motion
takes, and one candidate for each motor, gear and screw that are strong enough.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.lab.sizing import axis_drive
from facade_manipulator.lab.sizing.axis_drive import AxisDrive, Binding, Duty, Motor
from facade_manipulator.lab.sizing.demand import Demand, demand, Payload, Task
from facade_manipulator.lab.sizing.screw import BallScrew
from facade_manipulator.lab.study import measure, Requirements, section_area
from facade_manipulator.parameters import inherited, parameter, settings

DISTANCES = np.linspace(0.3, 0.9, 13)  # of the rail from the wall, as shares of l
THETA_NODES, Y_CELLS = 128, 64  # the ratio to 1e-3


@settings
class SizeLimits(Requirements):
    """What a machine may be like; its rail is no longer than `stroke_length`."""

    link_range: tuple[float, float] = inherited(
        Requirements, 'link_range', default=(0.15, 0.6))
    platform_range: tuple[float, float] = inherited(
        Requirements, 'platform_range', default=(0.1, 0.5))
    length_sum: float = inherited(Requirements, 'length_sum', default=0.0)
    stroke_length: float = parameter(
        'Longest stroke of the carriages', default=1.2, unit='m', minimum=1e-3, maximum=200.0)
    carriage_gap: float = inherited(Requirements, 'carriage_gap', default=0.04)
    designs: int = parameter(
        'Designs of l and b, scattered over the box; 0: in even steps', default=500, minimum=0,
        maximum=10**7)


class Problem(NamedTuple):
    """What is asked, and of what to choose; `stroke_length` of the need is the longest rail."""

    tasks: tuple[Task, ...]
    payload: Payload
    need: SizeLimits
    duty: Duty
    motors: tuple[Motor, ...]
    screws: tuple[BallScrew, ...]


class Design(NamedTuple):
    """A mechanism, where it stands, and what each task asks of its carriages."""

    geometry: Geometry
    offset: float  #: by how much farther from the wall than the goals say [m]
    demands: tuple[Demand, ...]


class Candidate(NamedTuple):
    """A machine, and what counts."""

    design: Design
    drive: AxisDrive
    rail: float  #: length [m]
    power: float  #: rated, of a motor [W]
    margin: float
    area: float  #: at θ = 0 [m²]
    ratio: float  #: well-conditioned share of the workspace
    binds: str

    @property
    def costs(self) -> tuple[float, ...]:
        """What is better the less it is."""
        return self.rail, self.power, -self.margin, -self.area, -self.ratio


class Examined(NamedTuple):
    """What became of a design."""

    candidates: tuple[Candidate, ...] = ()
    rail: float = np.inf  #: that it takes [m]; infinite where the mechanism cannot
    best: Binding = Binding(0.0, '')  #: of its best drives


def examine(lengths: list[float], problem: Problem) -> Examined:
    """Return the candidates of a design of l and b [m], in whichever process."""
    designs = list(_placed(lengths, problem))
    if not designs:
        return Examined()
    least = min(map(_rail, designs))
    if least > problem.need.stroke_length:
        return Examined(rail=least)
    design = min((one for one in designs if _rail(one) <= problem.need.stroke_length), key=_power)
    rated = list(_rated(design, problem))
    strong = [(drive, found) for drive, found in rated if found.margin >= problem.duty.margin]
    return Examined(tuple(_candidates(design, strong, problem.need)), _rail(design),
                    max(found for _, found in rated))


def front(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Return the candidates than which none is better in one respect and worse in none."""
    listed = list(candidates)
    costs = np.array([one.costs for one in listed])
    return [one for one, cost in zip(listed, costs, strict=True) if not np.any(
        (costs <= cost).all(axis=1) & (costs < cost).any(axis=1))]


def choice(candidates: Iterable[Candidate]) -> Candidate:
    """Return the candidate with the weakest motor, and of those the one with the shortest rail."""
    return min(candidates, key=lambda one: (one.power, one.rail))


def impossible(examined: list[Examined], problem: Problem) -> ManipulatorError:
    """Say why there is no candidate, ready to be raised."""
    beyond = [one.rail for one in examined if not one.best.what]
    if len(beyond) < len(examined):
        margin, binds = max(one.best for one in examined)
        return ManipulatorError(
            f'the best of all motors, gears and screws has a margin of {margin:.3g} ({binds}), '
            f'which is below {problem.duty.margin:g}')
    if np.isfinite(beyond).any():
        return ManipulatorError(
            f'the shortest rail that the motion takes is {min(beyond):.4g} m, which is above '
            f'{problem.need.stroke_length:g} m')
    return ManipulatorError(
        f'none of {len(examined)} designs reaches all poses with l from '
        f'{problem.need.link_range[0]:g} m to {problem.need.link_range[1]:g} m; next: a wider '
        '--link-range and --platform-range, a longer --longest-stroke, or less --wall-force')


def _placed(lengths: list[float], problem: Problem) -> Iterator[Design]:
    """Yield a design at each distance from the wall at which it can do all tasks."""
    geometry = problem.need.geometry(*lengths)
    middle = np.mean(np.concatenate([task.head[:, 1] for task in problem.tasks]))
    for offset in (share * lengths[0] - middle for share in DISTANCES):
        demands = [demand(geometry, task, problem.payload, offset) for task in problem.tasks]
        done = tuple(one for one in demands if one is not None)
        if len(done) == len(demands):
            stroke = min(one.stroke[0] for one in done), max(one.stroke[1] for one in done)
            yield Design(replace(geometry, stroke=stroke), float(offset), tuple(
                one._replace(stroke=stroke) for one in done))


def _rail(design: Design) -> float:
    return design.geometry.stroke_length


def _power(design: Design) -> float:
    return max(float(np.abs(one.power).max()) for one in design.demands)


def _rated(design: Design, problem: Problem) -> Iterator[tuple[AxisDrive, Binding]]:
    """Yield every drive with what binds; of its screw alone where that is too weak."""
    duty, demands = problem.duty, design.demands
    for screw in problem.screws:
        holds = min(
            axis_drive.binding(axis_drive.screw_margins(screw, one, duty)) for one in demands)
        for motor, gear_ratio in product(problem.motors, duty.gear_ratios):
            drive = AxisDrive(motor, gear_ratio, screw)
            if holds.margin < duty.margin:
                yield drive, holds
            else:
                yield drive, min(holds, *(
                    axis_drive.binding(axis_drive.motor_margins(drive, one, duty))
                    for one in demands))


def _candidates(
    design: Design, drives: list[tuple[AxisDrive, Binding]], need: Requirements
) -> Iterator[Candidate]:
    """Yield what is worth it of drives with their margins: the strongest of each power."""
    geometry, rail = design.geometry, _rail(design)
    area = float(section_area(geometry)) if drives else 0.0
    ratio = measure(geometry, need.threshold, need.characteristic_length, THETA_NODES,
                    Y_CELLS).ratio if drives else 0.0
    reached = 0.0
    for drive, (margin, binds) in sorted(
            drives, key=lambda one: (one[0].motor.power, -one[1].margin)):
        if margin > reached:
            yield Candidate(
                design, drive, rail, drive.motor.power, margin, area, ratio, binds)
            reached = margin
