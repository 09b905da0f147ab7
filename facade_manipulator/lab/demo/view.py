"""What the demo says in the terminal at its end: the figures."""

from __future__ import annotations

from facade_manipulator.lab.gondola import SCALES, Scenario, UNITS


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


def _cell(value: float | None, factor: float, unit: str) -> str:
    return '-' if value is None else f'{factor * value:.3g} {unit}'


def _giving_way(scenario: Scenario) -> list[str]:
    compensator = scenario.compensator
    axes = [axis for axis, impedance in (
        ('y', compensator.impedance), ('theta', compensator.yaw_impedance)) if impedance.enabled]
    return [f'{axis} gives way to the wall: its error is intended' for axis in axes]
