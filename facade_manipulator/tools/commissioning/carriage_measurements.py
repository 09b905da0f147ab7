"""Commands that move carriages or measure their motion."""

from __future__ import annotations

import math

import numpy as np

from facade_manipulator.canopen import indices
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.snapshot import AxisSnapshot
from facade_manipulator.drives.states import DigitalInput
from facade_manipulator.errors import CommissioningError
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.kinematics.planar import MM
from facade_manipulator.tools.commissioning.low_speed_motion import Motion, powered
from facade_manipulator.tools.commissioning.procedure import Context

_PUSHED = 0.002  # m
_PATIENCE = 120.0  # s


def run_direction(context: Context) -> None:
    """Determine the direction of an axis, whose carriage the operator pushes towards +q."""
    name = context.options.axis
    needed = abs(context.axes[name].to_counts(_PUSHED))
    context.agree(
        f'{name} stays without power, because its carriage is pushed by hand. '
        f'The direction is written to {context.overlay.path}.'
    )
    context.begin(f'direction {name}')
    with context.drive(name) as (bus, drive):

        def position() -> int:
            return bus.run(drive.read_number(indices.ACTUAL_POSITION, signed=True))

        start = position()

        def pushed() -> int:
            return position() - start

        print(
            f'Push the carriage of {name} to the right (towards +q) by a centimetre '
            f'within {_PATIENCE:g} s.'
        )
        if not bus.wait_for(lambda: abs(pushed()) >= needed, _PATIENCE):
            raise CommissioningError(
                f'{name} did not move by {MM * _PUSHED:g} mm within '
                f'{_PATIENCE:g} s; next: check this carriage and its encoder'
            )
        first = pushed()
        bus.wait(0.5)
        counts = pushed()
    print(f'{name} counted {counts:+d}.')
    if counts * math.copysign(1, first) < needed:
        raise CommissioningError(
            f'push of {name} rejected: the carriage moved back, from {first:+d} to {counts:+d} '
            f'counts, minimum {needed}; next: repeat without moving the carriage back'
        )
    context.record(f'direction {name}', {f'{name}.direction': 1 if counts > 0 else -1})


def run_jog(context: Context) -> None:
    """Move a carriage by a distance."""
    step = f'jog {context.options.axis}'
    _move(context, step, context.options.distance)
    context.record(step, {})


def _move(context: Context, step: str, distance: float) -> float:
    """Move by a distance [m]; print and return the displacement measured by the encoder [m]."""
    name = context.options.axis
    speed = context.options.speed
    action = f'by {MM * distance:+g} mm'
    with powered(context, step, action, abs(distance), speed) as motion:
        for _ in motion.go(math.copysign(speed, distance)):
            pass
        went = motion.rest()[name].position or 0.0
    print(f'{name} moved {MM * went:+.2f} mm according to its encoder.')
    return went


def run_lead(context: Context) -> None:
    """Move with the present lead, ask the operator for the real distance, and correct the lead."""
    name = context.options.axis
    lead = context.axes[name].lead
    print(
        f'Mark the place of carriage {name}. The lead is written to {context.overlay.path}.'
    )
    step = f'lead {name}'
    went = MM * _move(context, step, context.options.travel)
    text = context.options.measured or context.ask(
        'How many mm on the ruler (to the left: negative)?', '--measured'
    )
    try:
        ratio = float(text.replace(',', '.').removesuffix('mm')) / (went or math.nan)
    except ValueError:
        ratio = math.nan
    if not 0.05 < ratio < 20.0:
        raise CommissioningError(
            f'{text} mm rejected: its ratio to {went:.2f} mm is not between 0.05 and 20; next: '
            f'measure again, or commission direction {name} if the carriage moved the other way'
        )
    print(f'{name}: lead {MM * lead * ratio:.3f} mm (was {MM * lead:g} mm)')
    context.record(step, {f'{name}.lead': round(lead * ratio, 6)})


_APPROACH = 5e-4  # m/s, speed towards the switch
_RETREAT = 1e-3  # m, travel back from it
_WIDE_SPREAD = 2e-4  # m; every tenth SYNC reports the inputs, 0.05 mm apart
# homing methods that search for the home switch, by their initial direction
_HOME_SWITCH_METHODS = {1: (23, 24, 7, 8), -1: (27, 28, 11, 12)}
_INDEX_METHODS = (7, 8, 11, 12)  # home at an index pulse of the encoder beside the edge


def run_home_switch(context: Context) -> None:
    """Approach the switch repeatedly; print the spread, and write the homing method."""
    name = context.options.axis
    speed = context.options.speed
    count = context.options.approaches
    axis = context.axes[name]
    side = 1 if context.options.towards == '+' else -1
    with powered(
        context,
        f'home-switch {name}',
        f'{count} times to the home switch of {name} and back',
        context.options.window,
        speed,
    ) as motion:
        if _is_on(motion.turn()[name]):
            raise CommissioningError(
                f'switch of {name} rejected: it is on at the start; next: '
                'begin next to the switch, or invert its input in the drive'
            )
        edges = []
        _find_edge(motion, name, side * speed, True)
        for _ in range(count):
            _find_edge(motion, name, -side * speed, False, _RETREAT)
            edges.append(_find_edge(motion, name, side * min(speed, _APPROACH), True))
    spread = max(edges) - min(edges)
    print(
        f'{name}: edge at {MM * sum(edges) / count:+.2f} mm from the start, {count} approaches '
        f'spread over {MM * spread:.3f} mm'
    )
    if spread > _WIDE_SPREAD:
        print(
            f'! {name}: the spread is above {MM * _WIDE_SPREAD:g} mm; next: clean, adjust or '
            'replace the switch'
        )
    known = load_profile(axis.profile).homing_methods
    methods = [
        one for one in _HOME_SWITCH_METHODS[side * axis.direction] if one in known
    ]
    if not methods:
        raise CommissioningError(
            f'profile {axis.profile} rejected: it lists no homing method for '
            'this switch; next: home with another method'
        )
    context.record(f'home-switch {name}', {f'{name}.homing_method': methods[0]})
    if methods[0] in _INDEX_METHODS:
        print(
            f'! {name}: method {methods[0]} homes at an index pulse, at most '
            f'{MM * axis.lead / axis.gear_ratio:.1f} mm (a motor revolution) beside the edge; '
            'next: after the first homing, measure the position and correct home_position'
        )


def _deviations(axes: dict[str, AxisSnapshot]) -> list[float]:
    """Return target minus position of each axis [m]."""
    return [(one.target or 0.0) - (one.position or 0.0) for one in axes.values()]


def _is_on(axis: AxisSnapshot) -> bool:
    return bool((axis.digital_inputs or 0) & DigitalInput.HOME_SWITCH)


def _find_edge(
    motion: Motion, name: str, speed: float, is_on: bool, beyond: float = 0.0
) -> float:
    """Move until the switch changes, then a given distance further; return the switch edge [m]."""
    edge = None
    for axes in motion.go(speed):
        position = axes[name].position or 0.0
        if edge is None and _is_on(axes[name]) == is_on:
            edge = position
        if edge is not None and abs(position - edge) >= beyond:
            motion.rest()
            return edge
    raise CommissioningError(
        f'no change of the home switch within {MM * motion.window:.0f} mm; next: jog nearer, '
        'change --towards, or check its cable and 60FDh in the pdos of the profile'
    )


_LAG_SPEEDS = (0.01, 0.04)  # m/s
_LAG_TRAVEL = 0.02  # m
_DELAY = 2  # cycles from the choice of a target to the SYNC at which the drive should reach it
_ALIKE = 0.002  # s, maximum difference of the lag of an axis
_MS = 1e3


def run_lag(context: Context) -> None:
    """Measure each carriage's lag behind its target at two speeds; write the mean lag [s]."""
    errors = []
    with powered(
        context,
        'lag',
        f'back and forth by {MM * _LAG_TRAVEL:g} mm',
        _LAG_TRAVEL,
        max(_LAG_SPEEDS),
    ) as motion:
        for speed in _LAG_SPEEDS:
            list(motion.go(-speed))
            track = np.array([_deviations(axes) for axes in motion.go(speed)])
            at_speed = slice(len(track) // 4, 3 * len(track) // 4)
            errors.append(track[at_speed].mean(axis=0))
    # friction causes the same error at both speeds
    lags = (errors[1] - errors[0]) / (
        _LAG_SPEEDS[1] - _LAG_SPEEDS[0]
    ) - _DELAY * motion.period
    for name, lag in zip(AXIS_NAMES, lags, strict=True):
        print(f'{name}: lag {_MS * lag:.1f} ms')
        difference = abs(lag - np.median(lags))
        if difference > _ALIKE:
            print(
                f'! {name}: its lag differs by {_MS * difference:.1f} ms, above the '
                f'limit {_MS * _ALIKE:g} ms; next: check its screw and its tuning'
            )
    context.record(
        'lag', {'controller.drive_lag': max(0.0, round(float(lags.mean()), 4))}
    )
