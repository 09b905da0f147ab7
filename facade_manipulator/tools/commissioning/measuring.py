"""Commands `direction`, `lead` and `home-switch`: each ends in the line to write."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

import numpy as np

from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.errors import CommissioningError
from facade_manipulator.tools.commissioning import moving
from facade_manipulator.tools.commissioning.context import Context
from facade_manipulator.tools.commissioning.drive_objects import store
from facade_manipulator.tools.commissioning.keep import unpowered_drive
from facade_manipulator.tools.commissioning.motion import (
    AxisSample,
    INPUTS,
    Motion,
    PERIOD,
    POSITION,
    Ramp,
)

HOME_SWITCH = 0x4  # of 60FDh
_SLOW, _RETREAT = 0.002, 0.004  # m/s, m: of an approach to the switch
_PUSHED = 0.002  # m
_PATIENCE = 120.0  # s
_MM = 1e3
# homing methods that look for the home switch, by the direction in which they set out
_METHODS = {1: (23, 24, 7, 8), -1: (27, 28, 11, 12)}


def add_commands(add: Callable[..., Any]) -> None:
    """Add the commands to the tool."""
    add('direction', run_direction,
        'Whether a drive counts along the rail: push the carriage, without power.', has_axis=True)
    command = add('lead', run_lead, 'Travel per turn of the screw, against a distance measured.',
                  has_axis=True)
    command.add_argument('--travel', type=float, default=40.0, metavar='MM',
                         help='how far it goes by the present lead (default 40)')
    command.add_argument('--measured', type=float, metavar='MM',
                         help='how far the carriage went; default: asked for')
    moving.add_motion_options(command)
    command = add('home-switch', run_home_switch,
                  'Polarity and repeatability of a home switch, from ten approaches.',
                  has_axis=True)
    command.add_argument('--towards', choices=('+', '-'), default='+',
                         help='on which side of the carriage the switch is (default +)')
    command.add_argument('--approaches', type=int, default=10)
    moving.add_motion_options(command, speed=5.0)


# --- direction


def run_direction(context: Context) -> None:
    """Watch the position, without power, while somebody pushes the carriage towards +q."""
    name, machine = context.options.axis, context.machine
    axis = machine.axis(name)
    axis = load_profile(axis.profile).applied(axis)
    with context.bus() as bus:
        drive = unpowered_drive(context, bus, name)
        start = drive.read_number(POSITION, signed=True)
        context.operator.say(
            f'{name} has no power. Push its carriage to the right (towards +q) by a centimetre.')
        needed = abs(axis.to_counts(_PUSHED))
        if not bus.wait_for(lambda: abs(
                drive.read_number(POSITION, signed=True) - start) >= needed, _PATIENCE):
            raise CommissioningError(
                f'{name} counted no {_MM * _PUSHED:g} mm within {_PATIENCE:g} s: is it this '
                'carriage, does its encoder count, can the screw be turned by hand? Nothing is '
                'written')
        bus.collect(0.5)
        counts = drive.read_number(POSITION, signed=True) - start
    found = 1 if counts > 0 else -1
    context.operator.say(f'{name} counted {counts:+d}: direction {found}')
    if found != axis.direction:
        context.offer(name, direction=found)


# --- lead


def run_lead(context: Context) -> None:
    """Move by the present lead, ask how far it really was, and correct it."""
    name, options = context.options.axis, context.options
    axis = context.machine.axis(name)
    speed, window = moving.motion_bounds(context)
    travel = options.travel / _MM
    if not 0.005 <= abs(travel) <= window:
        raise CommissioningError(f'--travel {options.travel:g} mm is not between 5 and '
                                 f'{_MM * window:g} mm, the window')
    context.operator.say(f'Mark where the carriage of {name} stands.')
    with moving.powered(context, name, f'by {options.travel:g} mm') as motion:
        went = go(motion, travel, speed)
    measured = options.measured
    if measured is None:
        measured = _number(context.operator.ask(
            f'{name} went {_MM * went:.2f} mm by its counts. How many mm by the ruler?',
            '--measured'))
    if not 0.05 < abs(measured / _MM / went) < 20.0:
        raise CommissioningError(f'{measured:g} mm for {_MM * went:.1f} mm is no lead: nothing is '
                                 'written; measure again')
    lead = axis.lead * abs(measured / _MM / went)
    context.operator.say(f'{name}: lead {_MM * lead:.3f} mm (was {_MM * axis.lead:g})')
    if measured * went < 0.0:
        raise CommissioningError(
            f'{name} went the other way: commission direction {name} first; nothing is written')
    if abs(lead / axis.lead - 1.0) > 1e-3:
        context.offer(name, lead=round(lead, 6))


def _number(text: str) -> float:
    try:
        return float(text.replace(',', '.').removesuffix('mm'))
    except ValueError:
        raise CommissioningError(f'{text!r} is no number: nothing is written') from None


def go(motion: Motion, goal: float, speed: float) -> float:
    """Move by a displacement [m] and come to rest; return where the carriage stands."""
    motion.ramp, before = Ramp(abs(goal)), None
    while motion.ramp.displacement != before:
        before = motion.ramp.displacement
        motion.go(math.copysign(speed, goal))
    return motion.rest(30).position


# --- home switch


def run_home_switch(context: Context) -> None:
    """Approach the switch again and again; report polarity and spread."""
    name, options, operator = context.options.axis, context.options, context.operator
    axis, side = context.machine.axis(name), 1 if options.towards == '+' else -1
    speed, _ = moving.motion_bounds(context)
    if options.approaches < 1:
        raise CommissioningError(f'--approaches {options.approaches} is not 1 or more')
    with moving.powered(
            context, name, f'{options.approaches} times to its home switch and back') as motion:
        motion.require(INPUTS, 'the digital inputs')
        is_on_away, edges = find_switch(motion, side, speed, options.approaches)
    spread = _MM * float(np.ptp(edges))
    operator.say(
        f'{name}: the switch is {"on" if is_on_away else "off"} away from home; edge at '
        f'{_MM * np.mean(edges):+.2f} mm from here, {len(edges)} approaches spread over '
        f'{spread:.3f} mm')
    if spread > 0.1 + 2.0 * _MM * _SLOW * PERIOD:
        operator.say(f'! {name}: a spread above 0.1 mm: clean, adjust or replace the switch')
    if is_on_away:
        _correct_polarity(context, name, axis)
    _offer_method(context, name, axis, side)


def find_switch(
    motion: Motion, side: int, speed: float, count: int
) -> tuple[bool, list[float]]:
    """Return whether a switch is on away from home, and where it changed [m], so many times."""
    away = _is_on(motion.go(0.0))
    edges = []
    _until(motion, side * speed, not away)
    for _ in range(count):
        _until(motion, -side * speed, away)
        start = motion.ramp.displacement
        while abs(motion.ramp.displacement - start) < _RETREAT and (
                abs(motion.ramp.displacement) < motion.window):
            motion.go(-side * speed)
        motion.rest()
        edges.append(_until(motion, side * min(speed, _SLOW), not away))
    return away, edges


def _until(motion: Motion, speed: float, is_on: bool) -> float:
    """Go until the switch reads on, or off, and come to rest; return where it changed."""
    before = None
    while motion.ramp.displacement != before:
        before = motion.ramp.displacement
        sample = motion.go(speed)
        if _is_on(sample) == is_on:
            motion.rest()
            return sample.position
    raise CommissioningError(
        f'no change of the home switch within {_MM * motion.window:.0f} mm: jog nearer, look from '
        'the other side (--towards), or check its cable; the carriage stands')


def _is_on(sample: AxisSample) -> bool:
    return bool(sample.inputs & HOME_SWITCH)


def _correct_polarity(context: Context, name: str, axis: AxisSettings) -> None:
    """Turn the input in the drive, where its profile names an object for that."""
    where = load_profile(axis.profile).input_polarity
    if where is None:
        context.operator.say(
            f'! {name}: the switch opens at home: turn the polarity of its input in the '
            f"maker's tool, the profile {axis.profile} names no input_polarity")
        return
    place, label = where[:2], f'{where.index:04X}h:{where.subindex:02X}'
    with context.bus() as bus:
        drive = bus.objects(axis.node_id, name)
        present = drive.read(*place)
        polarity = int.from_bytes(present, 'little') ^ HOME_SWITCH << where.shift
        context.operator.agree(
            f'{name}: the switch opens at home: {label} of the drive becomes '
            f'{polarity:X}h and is stored')
        bus.reset(axis.node_id)  # nothing of the motion's limits is to be stored with it
        drive.write(*place, polarity.to_bytes(len(present), 'little'))
        store(bus, axis.node_id, name)
        if bus.objects(axis.node_id, name).read_number(*place) != polarity:
            raise CommissioningError(f'{name} did not keep the polarity of its inputs: set it in '
                                     "the maker's tool")


def _offer_method(context: Context, name: str, axis: AxisSettings, side: int) -> None:
    known = load_profile(axis.profile).homing_methods
    along = side * axis.direction  # the drive's own positive direction
    method = next((method for method in _METHODS[along] if method in known), None)
    if method is None:
        context.operator.say(f'The profile {axis.profile} has no homing method for this switch.')
    elif method != axis.homing_method:
        context.offer(name, homing_method=method)
