"""One page about a recording: why it was written, what the replay shows, what it cannot show."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime, timezone
import math
from pathlib import Path

import numpy as np

from facade_manipulator.blackbox import RecordedRun
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import CARRIAGES
from facade_manipulator.resources import version
from facade_manipulator.tools.replay.parameters import off_default, unmatched
from facade_manipulator.tools.replay.poses import Comparison, SETTLING, settling_of
from facade_manipulator.tools.replay.stop import Stop, StopReplay
from facade_manipulator.tools.replay.timeline import Event, timeline

SAME_SETPOINT = 1e-9  # m
SAME_POSE = 1e-3  # m or rad: estimates came to the recorder and to the compensator in turns


def page(
    source: Path, run: RecordedRun, poses: Comparison, setpoints: Comparison,
    stop: StopReplay, changes: Sequence[str] = (), estimates: Comparison | None = None,
) -> str:
    """Return the page as Markdown; `estimates` is None where not replayed."""
    return '\n'.join([
        f'# Replay of {source.name}', '',
        *_about(run, changes), '',
        '## What happened', '',
        *timeline(run, list(_deviations(poses, setpoints))), '',
        *_listed('Parameters that are not the default', off_default(run)),
        '## Corrected poses and setpoints', '',
        '| replayed | compared | RMS error | greatest error | verdict |', '|---|---|---|---|---|',
        *([_row('estimates', estimates, Pose._fields, SAME_POSE)] if estimates else []),
        _row('corrected poses', poses, Pose._fields, SAME_POSE),
        _row('setpoints', setpoints, CARRIAGES, SAME_SETPOINT), '',
        f'Corrected poses count from {settling_of(run):.1f} s after the beginning: what the '
        f'compensator had learnt before, it has to learn again, which takes up to {SETTLING:g} s.',
        *_rejections('the replay rejected', [
            *(estimates.rejections if estimates else ()), *poses.rejections,
            *setpoints.rejections]), '',
        '## The stop', '', *_stop(run, stop, changes), ''])


def _about(run: RecordedRun, changes: Sequence[str]) -> Iterator[str]:
    recorded, present = run.about.get('version', 'unknown'), version()
    begin = datetime.fromtimestamp(run.begin, timezone.utc)
    yield f'From {begin:%Y-%m-%d %H:%M:%S UTC}, {run.end - run.begin:.1f} s. Written because of:'
    yield ''
    yield from (f'- {reason}' for reason in run.reasons)
    yield ''
    yield (f'Recorded and replayed by version {present}.' if recorded == present else
           f'**Recorded by version {recorded}, replayed by {present}.**')
    if run.damage:
        yield f'\n**The file is damaged ({run.damage}): do not trust what follows.**'
    if changes:
        yield f'\n**Replayed with {", ".join(changes)}.**'
    yield ''
    yield from _listed('**Parameters of another version**', unmatched(run))
    later = [f'{message.node}: {", ".join(item.name for item in message.changed_parameters)}'
             for time, message in run.topics['/parameter_events']
             if message.changed_parameters and time >= run.begin]
    yield from _listed('Parameters that changed meanwhile; the replay has their last values',
                       later)


def _listed(what: str, lines: Iterable[str]) -> Iterator[str]:
    """Yield lines as a list under what they are, if there are any."""
    if lines := [f'- {line}' for line in lines]:
        yield from (f'{what}:', '', *lines, '')


def _deviations(poses: Comparison, setpoints: Comparison) -> Iterator[Event]:
    for what, comparison, bound in (('corrected poses', poses, SAME_POSE),
                                    ('setpoints', setpoints, SAME_SETPOINT)):
        if (time := comparison.first_deviation(bound)) is not None:
            yield Event(time, f'**replayed {what} differ from here on**')


def _row(name: str, comparison: Comparison, axes: Sequence[str], bound: float) -> str:
    errors = comparison.errors
    if not len(errors):
        return f'| {name} | 0 of {len(comparison.times)} | – | – | not enough was recorded |'
    verdict = 'as recorded' if np.abs(errors).max() <= bound else '**different**'
    cells = (', '.join(_number(axis, value) for axis, value in zip(axes, values, strict=True))
             for values in (np.sqrt(np.mean(errors ** 2, axis=0)), np.abs(errors).max(axis=0)))
    return f'| {name} | {len(errors)} | {" | ".join(cells)} | {verdict} |'


def _number(axis: str, value: float) -> str:
    if axis == 'theta':
        return f'{axis} {math.degrees(value):.3f}°'
    return f'{axis} {1e3 * value:.3f} mm'


def _rejections(who: str, messages: list[str]) -> Iterator[str]:
    if messages:
        yield ''
        yield f'{len(messages)} times {who} something, first: {messages[0]}'


def _stop(run: RecordedRun, stop: StopReplay, changes: Sequence[str]) -> Iterator[str]:
    yield f'- recorded: {_when_and_why(run, stop.recorded)}'
    yield f'- replayed: {_when_and_why(run, stop.replayed)}'
    yield '- the simulated drives were made to do: ' + ('; '.join(
        f'{fault.who} {fault.description} at {fault.time - run.begin:.2f} s'
        for fault in stop.faults) or 'nothing, the recording shows no fault of a drive')
    yield ''
    yield _verdict(stop, changes)
    yield from _rejections('the driver rejected', stop.rejections)


def _verdict(stop: StopReplay, changes: Sequence[str]) -> str:
    if changes:
        name = ', '.join(changes)
        if stop.replayed is None:
            return f'**With {name} it would not have stopped.**'
        cause = 'for the same cause' if stop.is_alike else 'for another cause'
        return f'**With {name} it would have stopped, {cause}.**'
    if stop.is_alike:
        return 'The same cause.'
    return ('**Another cause**: what stopped the machine came neither from the setpoints nor '
            'from what is recorded of the drives. Without frames of the bus, faults are known '
            'from /diagnostics alone.')


def _when_and_why(run: RecordedRun, stop: Stop | None) -> str:
    return f'at {stop.time - run.begin:.2f} s: {stop.cause}' if stop else 'no stop'
