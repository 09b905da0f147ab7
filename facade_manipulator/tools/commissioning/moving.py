"""Command `jog`, and what every command that moves asks first."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from facade_manipulator.errors import CommissioningError
from facade_manipulator.tools.commissioning.context import Context
from facade_manipulator.tools.commissioning.keys import held_keys
from facade_manipulator.tools.commissioning.motion import (
    ended_by_signals,
    MAX_SPEED,
    MAX_WINDOW,
    Motion,
)

LINKS = ('coupled', 'uncoupled')
_MM = 1e3


def add_commands(add: Callable[..., Any]) -> None:
    """Add the commands to the tool."""
    add_motion_options(
        add('jog', run_jog, 'Move a carriage slowly while a key is held.', has_axis=True))


def add_motion_options(
    command: argparse.ArgumentParser, speed: float = 10.0, window: float = 50.0,
    fastest: float = MAX_SPEED,
) -> None:
    """Add what says how a carriage may be moved, with its defaults in mm/s and mm."""
    add = command.add_argument
    command.set_defaults(fastest=fastest)
    add('--links', choices=LINKS,
        help='whether the links join the carriages: then all three move alike, and the mechanism '
             'stays closed wherever it stands; default: asked for')
    add('--speed', type=float, default=speed, metavar='MM/S',
        help=f'up to {_MM * fastest:g} (default {speed:g})')
    add('--window', type=float, default=window, metavar='MM',
        help=f'how far from where it stands, up to {_MM * MAX_WINDOW:g} (default {window:g})')


def motion_bounds(context: Context) -> tuple[float, float]:
    """Return speed [m/s] and window [m] of the options; raises a CommissioningError."""
    bounds = []
    for name, most, unit in (
            ('speed', context.options.fastest, 'mm/s'), ('window', MAX_WINDOW, 'mm')):
        value = getattr(context.options, name)
        if not 0.0 < value <= _MM * most:
            raise CommissioningError(
                f'--{name} {value:g} {unit} is not between 0 and {_MM * most:g} {unit}')
        bounds.append(value / _MM)
    return bounds[0], bounds[1]


@contextmanager
def powered(context: Context, name: str, action: str) -> Iterator[Motion]:
    """Ask, then lend the carriage under power; with coupled links all three, which move alike."""
    links = context.options.links or context.operator.ask(
        'Are the links joined to the carriages? [coupled/uncoupled]', '--links')
    if links not in LINKS:
        raise CommissioningError(f'{links} is neither coupled nor uncoupled: nothing is powered')
    speed, window = motion_bounds(context)
    moved = {name: context.machine.axis(name)}
    if links == 'coupled':
        moved = context.machine.axes
    context.operator.agree(
        f'{" and ".join(moved)} are reset, powered and moved: {action}, at most '
        f'{_MM * speed:g} mm/s and {_MM * window:g} mm from where they stand. Check the direction '
        'of each axis before, by commission direction. Keep clear, and keep the emergency stop in '
        'your hand.')
    controller = context.machine.controller
    with context.bus() as bus, ended_by_signals(), Motion(
            bus, moved, name, window, max(speed, MAX_SPEED), controller) as motion:
        yield motion
        for warning in motion.warnings:
            context.operator.say(f'! {warning}')


def run_jog(context: Context) -> None:
    """Move while a key is held."""
    name, operator = context.options.axis, context.operator
    speed, _ = motion_bounds(context)
    with powered(context, name, 'while a key is held') as motion, held_keys() as keys:
        operator.say('Hold → or d towards +, ← or a towards −; q ends. Powered.')
        while not keys.is_ended:
            motion.go(speed * keys.direction())
        moved = _MM * motion.rest().position
    operator.say(f'{name} stands {moved:+.2f} mm from where it was; power: {motion.power}.')
