"""What the demo says in the terminal: a live table or a line now and then, then the figures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console, Group
from rich.live import Live
from rich.padding import Padding
from rich.progress_bar import ProgressBar

from facade_manipulator.kinematics import Pose
from facade_manipulator.nodes.monitor import Observer, render
from facade_manipulator.simulation import SCALES, Scenario, UNITS


@contextmanager
def live_view(
    console: Console, observer: Observer, duration: float
) -> Iterator[Callable[[float], None]]:
    """Lend what shows the moment, given the time elapsed [s]: live where there is a terminal."""
    if not console.is_terminal:
        yield lambda elapsed: console.print(_line(observer, elapsed))
        return
    with Live(console=console, auto_refresh=False, transient=True) as live:
        yield lambda elapsed: live.update(_table(observer, elapsed, duration), refresh=True)


def summary_lines(summary: dict, scenario: Scenario) -> list[str]:
    """Return the figures of a run, and which axes give way in its scenario."""
    lines = [f'{"":8}{"uncompensated":>16}{"compensated":>16}{"attenuation":>14}   (RMS)']
    for axis, result in summary['axes'].items():
        without, error = (
            _cell(result[name], getattr(SCALES, axis), getattr(UNITS, axis))
            for name in ('disturbance_rms', 'residual_rms'))
        attenuation = _cell(result['attenuation_db'], 1.0, 'dB')
        lines.append(f'{axis:8}{without:>16}{error:>16}{attenuation:>14}')
    lines.append(
        f'{summary["bus_cycles"]} bus cycles, {summary["missed_cycles"]} missed, '
        f'{summary["drive_faults"]} drive faults, {summary["rejected_goals"]} goals rejected')
    return lines + _giving_way(scenario)


def _table(observer: Observer, elapsed: float, duration: float) -> Group:
    view = render(observer, f'{elapsed:5.1f} s of {duration:g} s   '
                  f'{observer.rejected()} rejections   (Ctrl-C stops the drives first)')
    bar = ProgressBar(total=duration, completed=elapsed)
    view.renderables.insert(1, Padding(bar))  # a bar alone does not end its line
    return view


def _line(observer: Observer, elapsed: float) -> str:
    columns = (
        ('goal', observer.client.goal),
        ('disturbance', observer.poses.get('gondola_simulator/uncompensated_error')),
        ('from the goal', observer.poses.get('gondola_simulator/wall_error')),
    )
    cells = [f'{name} {_triple(pose)}' for name, pose in columns]
    cells.append(f'{observer.count("driver: bus", "cycles")} cycles')
    cells.append(f'{observer.rejected()} rejections')
    return f'{elapsed:5.1f} s  ' + '  '.join(cells)


def _triple(pose: Pose | None) -> str:
    if pose is None:
        return '-'
    x, y, theta = (scale * value for scale, value in zip(SCALES, pose, strict=True))
    return f'{x:+7.1f} {y:+6.1f} mm {theta:+5.2f}°'


def _cell(value: float | None, factor: float, unit: str) -> str:
    return '-' if value is None else f'{factor * value:.3g} {unit}'


def _giving_way(scenario: Scenario) -> list[str]:
    compensator = scenario.compensator
    axes = [axis for axis, impedance in (
        ('y', compensator.impedance), ('theta', compensator.yaw_impedance)) if impedance.enabled]
    return [f'{axis} gives way to the wall: its error is intended' for axis in axes]
