"""Commands that move or measure one axis: `direction`, `jog`, `lead`, `home-switch`, `lag`."""

from __future__ import annotations

import math
from threading import Event

from facade_manipulator.drives.axis_settings import AXIS_NAMES
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.snapshot import ControllerSnapshot
from facade_manipulator.errors import CommissioningError
from facade_manipulator.tools.commissioning.context import Context
from facade_manipulator.tools.commissioning.motion import MAX_SPEED, MAX_WINDOW, Motion, powered

POSITION = 0x6064
HOME_SWITCH = 0x4  # of 60FDh
_APPROACH, _RETREAT = 5e-4, 1e-3  # m/s, m: of an approach to the switch
_WIDE_SPREAD = 2e-4  # m; the inputs come with every tenth SYNC, 0.05 mm apart
_PUSHED, _PATIENCE = 0.002, 120.0  # m, s
_LAG_SPEEDS, _LAG_TRAVEL = (0.01, 0.04), 0.02  # m/s, m
_DELAY = 2  # cycles from the choice of a target to the SYNC at which the drive shall be there
_ALIKE = 0.002  # s, by which the lag of an axis may differ
_MM, _MS = 1e3, 1e3
# homing methods that look for the home switch, by the direction in which they set out
_METHODS = {1: (23, 24, 7, 8), -1: (27, 28, 11, 12)}


def option(context: Context, name: str, unit: str, most: float) -> float:
    """Return an option in millimetres in SI units; a CommissioningError beyond its bound."""
    value = getattr(context.options, name)
    if not 0.0 < abs(value) <= _MM * most:
        raise CommissioningError(
            f'{name} rejected: {value:g} {unit} is not between 0 and {_MM * most:g} {unit}')
    return value / _MM


def run_direction(context: Context) -> None:
    """Read the position, without power, while the operator pushes the carriage towards +q."""
    name = context.options.axis
    axis = context.axes[name]
    context.agree(f'{name} has no power and gets none: its carriage is pushed by hand. '
                  f'{context.overlay.path} gets its direction.')
    with context.bus() as bus:
        drive = context.drive(bus, name)
        start = drive.read_number(POSITION, signed=True)
        print(f'Push the carriage of {name} to the right (towards +q) by a centimetre.')
        needed = abs(axis.to_counts(_PUSHED))
        if not bus.wait_for(lambda: abs(
                drive.read_number(POSITION, signed=True) - start) >= needed, _PATIENCE):
            raise CommissioningError(
                f'timed out after {_PATIENCE:g} s waiting for {_MM * _PUSHED:g} mm of {name}; '
                'next: check that it is this carriage and that its encoder counts')
        bus.wait(Event(), 0.5)
        counts = drive.read_number(POSITION, signed=True) - start
    print(f'{name} counted {counts:+d}.')
    context.record(f'direction {name}', **{name: {'direction': 1 if counts > 0 else -1}})


def run_jog(context: Context) -> None:
    """Move by a distance."""
    name = context.options.axis
    went = _move(context, option(context, 'distance', 'mm', MAX_WINDOW))
    print(f'{name} went {_MM * went:+.2f} mm by its counts.')
    context.record(f'jog {name}')


def _move(context: Context, distance: float) -> float:
    """Move by a distance [m]; return how far the carriage went by its counts [m]."""
    name, speed = context.options.axis, option(context, 'speed', 'mm/s', MAX_SPEED)
    with powered(context, name, f'by {_MM * distance:+g} mm', abs(distance), speed) as motion:
        for _ in motion.go(math.copysign(speed, distance)):
            pass
        return _position(motion.rest(), name)


def _position(snapshot: ControllerSnapshot, name: str) -> float:
    """Return the displacement of a carriage from its start [m]."""
    return snapshot.axes[AXIS_NAMES.index(name)].position or 0.0


def run_lead(context: Context) -> None:
    """Move by the present lead, ask for the real distance, and correct the lead."""
    name = context.options.axis
    distance, lead = option(context, 'travel', 'mm', MAX_WINDOW), context.axes[name].lead
    print(f'Mark where the carriage of {name} stands. {context.overlay.path} gets its lead.')
    went = _MM * _move(context, distance)
    text = context.options.measured or context.ask(
        f'{name} went {went:+.2f} mm by its counts. How many mm by the ruler?', '--measured')
    try:
        ratio = float(text.replace(',', '.').removesuffix('mm')) / (went or math.nan)
    except ValueError:
        ratio = math.nan
    if ratio < 0.0:
        raise CommissioningError(f'{text} mm rejected: {name} went the other way; next: '
                                 f'commission direction {name}')
    if not 0.05 < ratio < 20.0:
        raise CommissioningError(f'{text} mm rejected: its ratio to {went:.2f} mm is not between '
                                 '0.05 and 20; next: measure again')
    print(f'{name}: lead {_MM * lead * ratio:.3f} mm (was {_MM * lead:g} mm)')
    context.record(f'lead {name}', **{name: {'lead': round(lead * ratio, 6)}})


def run_home_switch(context: Context) -> None:
    """Approach the switch repeatedly; report polarity and spread, and write the homing method."""
    name, options = context.options.axis, context.options
    axis, side = context.axes[name], 1 if options.towards == '+' else -1
    window, speed = (option(context, 'window', 'mm', MAX_WINDOW),
                     option(context, 'speed', 'mm/s', MAX_SPEED))
    action = f'{options.approaches} times to the home switch of {name} and back'
    with powered(context, name, action, window, speed) as motion:
        is_on_away = _is_on(motion.turn(), name)
        edges = []
        _find_edge(motion, name, side * speed, not is_on_away)
        for _ in range(options.approaches):
            edge = _find_edge(motion, name, -side * speed, is_on_away)
            for snapshot in motion.go(-side * speed):
                if abs(_position(snapshot, name) - edge) > _RETREAT:
                    break
            motion.rest()
            edges.append(_find_edge(motion, name, side * min(speed, _APPROACH), not is_on_away))
    spread = max(edges) - min(edges)
    print(f'{name}: the switch is {"on" if is_on_away else "off"} away from home; edge at '
          f'{_MM * sum(edges) / len(edges):+.2f} mm from the start, {len(edges)} approaches '
          f'spread over {_MM * spread:.3f} mm')
    if spread > _WIDE_SPREAD:
        print(f'! {name}: the spread is above {_MM * _WIDE_SPREAD:g} mm; next: clean, adjust or '
              'replace the switch')
    profile = load_profile(axis.profile)
    if is_on_away:
        raise CommissioningError(f'{name} rejected: its switch opens at home; next: invert the '
                                 'polarity of the input in the drive, and repeat')
    methods = _METHODS[side * axis.direction]  # the drive's own direction
    method = next((one for one in methods if one in profile.homing_methods), None)
    if method is None:
        raise CommissioningError(f'{name} rejected: profile {axis.profile} has no homing method '
                                 'for this switch; next: home by another method')
    context.record(f'home-switch {name}', **{name: {'homing_method': method}})


def _is_on(snapshot: ControllerSnapshot, name: str) -> bool:
    return bool((snapshot.axes[AXIS_NAMES.index(name)].digital_inputs or 0) & HOME_SWITCH)


def _find_edge(motion: Motion, name: str, speed: float, is_on: bool) -> float:
    """Move until the switch is on, or off, and come to rest; return where it changed [m]."""
    for snapshot in motion.go(speed):
        if _is_on(snapshot, name) == is_on:
            motion.rest()
            return _position(snapshot, name)
    raise CommissioningError(
        f'no change of the home switch within {_MM * motion.window:.0f} mm; next: jog nearer, '
        'change --towards, or check its cable and 60FDh in the pdos of the profile')


def run_lag(context: Context) -> None:
    """Measure how far each carriage is behind its target, by speed, and write the mean lag."""
    errors = []
    with powered(context, AXIS_NAMES[0], f'to and fro by {_MM * _LAG_TRAVEL:g} mm', _LAG_TRAVEL,
                 max(_LAG_SPEEDS)) as motion:
        for speed in _LAG_SPEEDS:
            list(motion.go(-speed))
            errors.append(_errors(motion, speed))
    (slow, fast), step = errors, _LAG_SPEEDS[1] - _LAG_SPEEDS[0]
    # friction makes the same error at both speeds
    lags = [(more - less) / step for less, more in zip(slow, fast, strict=True)]
    middle = sorted(lags)[1]
    for name, lag in zip(AXIS_NAMES, lags, strict=True):
        print(f'{name}: lag {_MS * lag:.1f} ms')
        if abs(lag - middle) > _ALIKE:
            print(f'! {name}: its lag differs by {_MS * abs(lag - middle):.1f} ms, bound '
                  f'{_MS * _ALIKE:g} ms; next: check its screw and its tuning')
    mean = max(0.0, round(sum(lags) / len(lags), 4))
    context.record('lag', controller={'drive_lag': mean})


def _errors(motion: Motion, speed: float) -> list[float]:
    """Move through the window; return the mean distance of each carriage from its target [m]."""
    targets, positions = [], []
    for snapshot in motion.go(speed):
        targets.append(motion.targets.displacement)
        positions.append([axis.position or 0.0 for axis in snapshot.axes])
    middle = range(len(targets) // 4, 3 * len(targets) // 4)  # at a constant speed
    return [sum(targets[number - _DELAY] - positions[number][axis] for number in middle)
            / len(middle) for axis in range(len(AXIS_NAMES))]
