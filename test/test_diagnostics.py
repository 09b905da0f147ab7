"""
One table of the keys of /diagnostics: nodes publish no other, and the document is made from it.

``python test/test_diagnostics.py`` prints that.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
import re

from diagnostic_msgs.msg import DiagnosticStatus
import pytest

import facade_manipulator
from facade_manipulator.compensation.compensator import Compensator, CorrectedPose, DEFAULTS
from facade_manipulator.compensation.correction import Correction
from facade_manipulator.compensation.following import HeldBack
from facade_manipulator.control_loop.control_loop import StreamStatus
from facade_manipulator.diagnostics import (
    AXIS,
    BY_NAME,
    COMPONENTS,
    pattern,
    REJECTIONS,
    unknown_keys,
)
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.monitor import AxisMonitor
from facade_manipulator.drives.snapshot import ControllerSnapshot
from facade_manipulator.kinematics import Geometry, ZERO_POSE
from facade_manipulator.messages import OutOfPlane, status_values
from facade_manipulator.nodes import driver_diagnostics
from facade_manipulator.nodes.compensator_report import CompensatorReport

ROOT = Path(facade_manipulator.__file__).parents[1]
OF_THE_NODE = {'drive faults', 'targets ahead of their SYNC [ms]', 'parameters', 'limits changed',
               'version', 'profiles'}
DOCUMENT = ROOT / 'docs/diagnostics.md'


def document() -> str:
    """Return the document of the table."""
    parts = ['# /diagnostics\n\nMade of `facade_manipulator/diagnostics.py` by `python '
             'test/test_diagnostics.py`. In a namespace that stands\nbefore the names: '
             '`gondola_1/driver: bus`. What stands for `*` is filled in; units are in the keys.\n']
    for one in COMPONENTS:
        rows = (f'| `{key}` | {meaning} |\n' for key, meaning in one.keys.items())
        parts.append(f'\n## {one}\n\n{one.levels[0].upper()}{one.levels[1:]}.\n\n'
                     f'| key | what |\n|---|---|\n{"".join(rows)}')
    return ''.join(parts)


@pytest.mark.skipif(not DOCUMENT.parent.is_dir(), reason='the documents are in the source alone')
def test_the_document_is_made_of_the_table():
    assert DOCUMENT.read_text(encoding='utf-8') == document()


def test_every_key_has_a_meaning_and_every_measure_a_unit():
    for one in COMPONENTS:
        assert one.levels and all(one.keys.values())
        units = {unit for key in one.keys for unit in re.findall(r'\[(.+)\]', key)}
        assert units <= {*'s ms m mm m/s N N/mm % Hz *'.split(), 'N m'}


def reports(monkeypatch) -> list[DiagnosticStatus]:
    """Return what driver and compensator say, with all that is not said every day."""
    axis = AxisMonitor('q1', AxisSettings(), ControllerSettings()).snapshot(None, 0.0)
    snapshot = ControllerSnapshot(ControllerState.UNCONFIGURED, 0.0, (axis,))
    lateral = replace(DEFAULTS.lateral, enabled=True)
    compensator = Compensator(Geometry(), DEFAULTS._replace(lateral=lateral))
    monkeypatch.setattr(Correction, 'deviations', lambda *_: 2 * ((0.0, 0.0, 0.0),))
    of_the_compensator = CompensatorReport(compensator, HeldBack())
    of_the_compensator.out_of_plane = OutOfPlane(0.1, 0.1)
    of_the_compensator.newest = CorrectedPose(0.0, *[ZERO_POSE] * 6)
    return [
        driver_diagnostics.operation_status(snapshot, StreamStatus(margins=(0.0, 0.0)), '', {}),
        driver_diagnostics.bus_status(snapshot), driver_diagnostics.axis_status(axis),
        *of_the_compensator.components(0.0, {}),
    ]


def test_driver_and_compensator_say_what_is_in_the_table_and_nothing_else(monkeypatch):
    by_rejections = {*REJECTIONS, *OF_THE_NODE}
    for status in reports(monkeypatch):
        component, keys = BY_NAME.get(status.name, AXIS), status_values(status)
        assert not unknown_keys(status.name, keys), status.name
        assert not [key for key in component.keys.keys() - by_rejections
                    if not any(re.fullmatch(pattern(key), one) for one in keys)], status.name


if __name__ == '__main__':
    print(document(), end='')
