"""Options of a command that are fields of settings."""

from __future__ import annotations

import argparse

from facade_manipulator.parameters import METADATA_KEY, parameter_fields

OPTIONS = {'link_length': 'l', 'platform_half_length': 'b', 'carriage_gap': 'gap',
           'length_sum': 'sum', 'stroke_length': 'longest-stroke',
           'force': 'drive-force', 'speed': 'drive-speed'}


def add_settings(group: argparse._ArgumentGroup, cls: type, *names: str) -> None:
    """Add an option for each of some fields of settings; without it the field has its default."""
    for name in names:
        item = parameter_fields(cls)[name]
        info, default = item.metadata[METADATA_KEY], item.default
        values = default if isinstance(default, tuple) else (default,)
        several = {1: None, 2: 2}.get(len(values), '+')
        unit = f' [{info.unit}]' if info.unit else ''
        shown = ' '.join(map('{:g}'.format, values) if isinstance(values[0], float)
                         else map(str, values))
        group.add_argument(
            '--' + OPTIONS.get(name, name.replace('_', '-')), dest=name, type=type(values[0]),
            nargs=several, default=argparse.SUPPRESS, choices=info.choices or None,
            metavar=('MIN', 'MAX') if several == 2 else None if info.choices
            else info.unit.upper() or 'NUMBER',
            help=f'{info.description}{unit} (default {shown})')
