"""What a design is written as: rows of tables, and the parameter file of the nodes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from facade_manipulator.compensation import CompensationSettings
from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import inverse_kinematics, Pose
from facade_manipulator.lab.gondola import read_sections, rms, Scenario
from facade_manipulator.lab.sizing import axis_drive
from facade_manipulator.lab.sizing.candidates import Candidate
from facade_manipulator.lab.sizing.screw import buckling_load, critical_speed
from facade_manipulator.motion import MotionLimits
from facade_manipulator.nodes.parameter_files import read_driver

FRONT = ('l [m]', 'b [m]', 'farther from the wall [m]', 'rail [m]', 'motor', 'gear', 'screw',
         'rated power [W]', 'margin', 'area [m2]', 'ratio', 'binds')
RESERVE = 1.25  # of speed that the limits leave beyond the motion, if drives can
SPEED_RESERVE, STOP_RESERVE = 1.2, 2.0  # of the drives beyond these limits, as shipped
HEADER = """# A machine found by design: {drive}.
# Lengths, screws and motors are as calculated; node ids, profile and home positions are examples.
"""
#: as shipped, of driver and compensator; those of the compensator grow with the driver's
LIMITS, PACE = MotionLimits(), CompensationSettings()


def front_rows(candidates: Iterable[Candidate]) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of the table of candidates."""
    for one in candidates:
        geometry, drive = one.design.geometry, one.drive
        yield (*(round(value, 4) for value in (
            geometry.link_length, geometry.platform_half_length, one.design.offset, one.rail)),
            drive.motor.name, drive.gear_ratio, drive.screw.name, round(one.power, 1),
            *(round(value, 3) for value in (one.margin, one.area, one.ratio)), one.binds)


def axis_rows(chosen: Candidate, duty: axis_drive.Duty) -> list[tuple[Any, ...]]:
    """Return a row for each quantity of the three axes, the worst of all tasks."""
    drive, demands = chosen.drive, chosen.design.demands
    length = axis_drive.screw_length(demands[0], duty)
    quantities: dict[str, list[np.ndarray]] = {}
    for of in demands:
        torque = axis_drive.torques(drive, of, duty)
        power = np.pi * 2.0 * drive.turns * torque * of.speed
        signals = {'speed [m/s]': of.speed, 'acceleration [m/s2]': of.acceleration,
                   'force [N]': of.force, 'motor torque [N m]': torque, 'motor power [W]': power}
        for name, values in signals.items():
            quantities.setdefault(f'{name} RMS', []).append(rms(values))
            quantities.setdefault(f'{name} peak', []).append(np.abs(values).max(axis=0))
        quantities.setdefault('stroke used [m]', []).append(np.ptp(of.position, axis=0))
    rows = [(name, *np.max(values, axis=0).tolist()) for name, values in quantities.items()]
    lives = np.min([axis_drive.life_hours(drive.screw, of, duty) for of in demands], axis=0)
    screw = drive.screw
    return [*rows, ('life of the screw [h]', *lives.tolist()),
            ('critical speed [rev/s]', *3 * [critical_speed(screw.core, length, duty.mounting)]),
            ('buckling load [N]', *3 * [buckling_load(screw.core, length, duty.mounting)])]


def limits_of(chosen: Candidate) -> MotionLimits:
    """
    Return limits of motion with a reserve beyond what was asked, within what drives can.

    Of the acceleration it is all that they can: the noise of the prediction takes it.
    """
    speed, acceleration = (
        reserve * max(float(np.abs(getattr(of, name)).max()) for of in chosen.design.demands)
        for name, reserve in (('speed', min(chosen.margin, RESERVE)),
                              ('acceleration', chosen.margin)))
    acceleration = round(acceleration, 3)
    rise = LIMITS.acceleration / LIMITS.jerk  # s, of the whole acceleration
    return MotionLimits(round(speed, 3), acceleration, round(acceleration / rise, 1))


def write_machine(path: Path, chosen: Candidate) -> None:
    """
    Write the parameters of the machine that was chosen; all others have their defaults.

    Raises a ParameterError if the driver would not start with them: the carriages would not stop
    apart.
    """
    path.write_text(HEADER.format(drive=chosen.drive.name) + yaml.safe_dump(
        _parameters(chosen), sort_keys=False, default_flow_style=None), encoding='utf-8')
    try:
        read_driver([path]).check()
    except ParameterError as error:
        raise ParameterError(f'the machine would not start: {error} (--gap)') from error


def _parameters(chosen: Candidate) -> dict[str, Any]:
    limits, drive, geometry = limits_of(chosen), chosen.drive, chosen.design.geometry
    speed, acceleration = (
        limits.speed / LIMITS.speed, limits.acceleration / LIMITS.acceleration)
    axis = {'profile': 'epos4', 'lead': drive.screw.lead, 'gear_ratio': drive.gear_ratio,
            'rated_torque': drive.motor.rated_torque,
            'max_speed': round(SPEED_RESERVE * limits.speed, 3)} | dict.fromkeys(
                ('max_acceleration', 'stop_deceleration'),
                round(STOP_RESERVE * limits.acceleration, 3))
    poses = np.concatenate([of.pose for of in chosen.design.demands])
    x, _, theta = poses.mean(axis=0).tolist()
    homes = inverse_kinematics(geometry, Pose(x, float(poses[:, 1].min()), theta))  # off the wall
    axes = {name: {'node_id': number, 'home_position': round(home, 4), **axis}
            for number, (name, home) in enumerate(zip(axis_drive.AXES, homes, strict=True), 1)}
    lengths = {name: round(getattr(geometry, name), 5) for name in (
        'link_length', 'platform_half_length', 'carriage_gap')}
    sections = {
        '/**': {'geometry': lengths | {'stroke': [round(end, 4) for end in geometry.stroke]}},
        '/**/driver': {'limits': vars(limits)} | axes,
        '/**/compensator': {
            'speed': [round(speed * value, 3) for value in PACE.speed],
            'acceleration': [round(acceleration * value, 3) for value in PACE.acceleration]}}
    return {name: {'ros__parameters': values} for name, values in sections.items()}


def write_scenario(path: Path, source: Path, scenario: Scenario, offset: float) -> None:
    """Write a copy of a scenario's file, goals and wall farther from the rail by an offset [m]."""
    sections, mission = read_sections(source), scenario.mission
    goals = [round(value + offset * (number % 3 == 1), 5)
             for number, value in enumerate(mission.goals)]
    changed = {'goals': goals} | ({'recording': mission.recording} if mission.recording else {})
    sections['mission'] = sections.get('mission', {}) | changed
    if scenario.facade.present:
        sections['facade']['distance'] = round(scenario.facade.distance + offset, 5)
    if scenario.sensors.rail.present:
        sections['sensors']['rail']['distance'] = round(scenario.sensors.rail.distance + offset, 5)
    path.write_text(yaml.safe_dump(sections, sort_keys=False), encoding='utf-8')
