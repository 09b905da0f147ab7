"""What the demo leaves: figures, pictures and an animation, each file whole or not at all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from facade_manipulator import diagnostics
from facade_manipulator.files import atomic_write
from facade_manipulator.kinematics import Geometry
from facade_manipulator.lab.demo.collector import Collector
from facade_manipulator.lab.demo.course import forces_of
from facade_manipulator.lab.gondola.course import Course, decibels
from facade_manipulator.lab.gondola.wall import SCALES, UNITS
from facade_manipulator.simulation.world.scenario import Scenario

SUMMARY = 'summary.json'
TIME_COURSES, SPECTRUM, PATH, BEFORE_AFTER, FORCE, LINKAGE = PICTURES = (
    'time_courses.png', 'spectrum.png', 'path.png', 'before_after.png', 'force.png',
    'linkage.gif')


def counters(collector: Collector, duration: float) -> dict[str, Any]:
    """Return what the nodes counted during strokes of a duration [s]."""
    def count(component: diagnostics.DiagnosticComponent, key: str) -> int:
        return int(collector.value(component, key) or 0)

    return {
        'duration_s': round(duration, 3),
        'pipeline_latency_ms': _latency(collector),
        'bus_cycles': count(diagnostics.BUS, 'cycles'),
        'missed_cycles': count(diagnostics.BUS, 'missed cycles'),
        'rejected_goals': count(diagnostics.GOAL, diagnostics.REJECTED),
        'drive_faults': count(diagnostics.OPERATION, 'drive faults'),
    }


def _latency(collector: Collector) -> dict[str, float | None]:
    """
    From the compensator's decision to the SYNC at which the drives take the target.

    The compensator stamps its poses a horizon ahead of the decision, and the driver publishes how
    much of it was left (margin) when it chose the target of a cycle.
    """
    horizon = collector.value(diagnostics.CORRECTION, 'horizon [ms]')
    ahead = collector.value(diagnostics.OPERATION, 'targets ahead of their SYNC [ms]')
    margins = {
        'p50': collector.value(diagnostics.OPERATION, 'setpoint margin p50 [ms]'),
        'p99': collector.value(diagnostics.OPERATION, 'setpoint margin p1 [ms]'),
    }
    return {
        name: round(float(horizon) - float(ahead) - float(margin), 3)
        if horizon and ahead and margin else None
        for name, margin in margins.items()}


def summary_lines(summary: dict[str, Any], scenario: Scenario) -> list[str]:
    """Return the figures of a run, and the axes that yield to the contact force."""
    lines = [f'{"":8}{"uncompensated":>16}{"compensated":>16}{"attenuation":>14}   (RMS)']
    for (axis, result), scale, unit in zip(summary['axes'].items(), SCALES, UNITS, strict=True):
        without, error, attenuation = result.values()
        lines.append(f'{axis:8}{_cell(scale * without, unit)}{_cell(scale * error, unit)}'
                     f'{decibels(attenuation):>14}')
    return [
        *lines,
        f'{summary["bus_cycles"]} bus cycles, {summary["missed_cycles"]} missed, '
        f'{summary["drive_faults"]} drive faults, {summary["rejected_goals"]} goals rejected',
        *(f'{axis} yields to the contact force: an offset is intended'
          for axis in giving_way(scenario))]


def giving_way(scenario: Scenario) -> list[str]:
    """Return the axes that yield to the wall: the head leaves the goal along them on purpose."""
    return [axis for axis, name in (
        ('y', 'impedance.enabled'), ('theta', 'yaw_impedance.enabled'))
        if scenario.compensator.get(name)]


def _cell(value: float, unit: str) -> str:
    return f'{f"{value:.3g} {unit}":>16}'


def draw(
    folder: Path, collector: Collector, course: Course, summary: dict[str, Any],
    scenario: Scenario, geometry: Geometry, check: Callable[[], None],
) -> None:
    """Draw everything; what `check` raises ends it, with complete files alone."""
    # matplotlib comes in here, so that the nodes' start does not wait for it
    from facade_manipulator.lab.demo import animation
    from facade_manipulator.lab.gondola import pictures

    shifted = giving_way(scenario)
    drawn = {
        TIME_COURSES: pictures.time_courses(course, summary['axes'], shifted),
        SPECTRUM: pictures.spectrum(course, shifted), PATH: pictures.paths(course),
        BEFORE_AFTER: animation.before_and_after(course, geometry, scenario.wall)}
    times, forces = forces_of(collector, course)
    if len(times):
        drawn[FORCE] = pictures.pressing(
            course, times, forces, scenario.compensator.get('impedance.force'))
    for name, figure in drawn.items():
        check()
        with atomic_write(folder / name) as draft:
            pictures.save(figure, draft)
    images = []
    for image in animation.frames(course, geometry, scenario.wall):
        check()
        images.append(image)
    with atomic_write(folder / LINKAGE) as draft:
        animation.save(draft, images)
