"""One page about a recording: why it was written, what the replay shows, what it cannot show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime, timezone
import math
from pathlib import Path

import numpy as np

from facade_manipulator.blackbox import RecordedRun
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import CARRIAGES
from facade_manipulator.tools.replay.poses import Comparison, SETTLING
from facade_manipulator.tools.replay.stop import Stop, StopReplay

SAME_SETPOINT = 1e-9  # m
SAME_POSE = 1e-3  # m or rad: estimates came to the recorder and to the compensator in turns


def page(
    source: Path, run: RecordedRun, poses: Comparison, setpoints: Comparison,
    stop: StopReplay | None,
) -> str:
    """Return the page as Markdown; `stop` is None where it was not replayed."""
    return '\n'.join([
        f'# Replay of {source.name}', '',
        *_about(run), '',
        '## Corrected poses and setpoints', '',
        '| replayed | compared | RMS error | greatest error | verdict |', '|---|---|---|---|---|',
        _row('corrected poses', poses, Pose._fields, SAME_POSE),
        _row('setpoints', setpoints, CARRIAGES, SAME_SETPOINT), '',
        f'Corrected poses count from {SETTLING:g} s after the beginning: what the compensator '
        'had learnt before, it has to learn again.',
        *_rejections('the replay rejected', [*poses.rejections, *setpoints.rejections]), '',
        '## The stop', '', *_stop(run, stop), ''])


def _about(run: RecordedRun) -> Iterator[str]:
    yield f'From {_clock(run.begin)}, {run.end - run.begin:.1f} s. Written because of:'
    yield ''
    yield from (f'- {reason}' for reason in run.reasons)
    if run.damage:
        yield f'\n**The file is damaged ({run.damage}): this is what there was before.**'
    changes = [f'{message.node}: {", ".join(item.name for item in message.changed_parameters)}'
               for time, message in run.topics['/parameter_events']
               if message.changed_parameters and time >= run.begin]
    if changes:
        yield '\nParameters that changed meanwhile; the replay has their last values: ' + (
            '; '.join(changes))


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


def _stop(run: RecordedRun, stop: StopReplay | None) -> Iterator[str]:
    if stop is None:
        yield 'Not replayed.'
        return
    yield f'- recorded: {_when_and_why(run, stop.recorded)}'
    yield f'- replayed: {_when_and_why(run, stop.replayed)}'
    yield '- the simulated drives were made to do: ' + ('; '.join(
        f'{CARRIAGES[fault.axis]} {fault.description} at {fault.time - run.begin:.2f} s'
        for fault in stop.faults) or 'nothing, the recording shows no fault of a drive')
    yield ''
    if stop.is_alike:
        yield 'The same cause.'
    else:
        yield ('**Another cause**: what stopped the machine came neither from the setpoints nor '
               'from what is recorded of the drives. Without frames of the bus, faults are known '
               'from /diagnostics alone.')
    yield from _rejections('the driver rejected', stop.rejections)


def _when_and_why(run: RecordedRun, stop: Stop | None) -> str:
    return f'at {stop.time - run.begin:.2f} s: {stop.cause}' if stop else 'no stop'


def _clock(time: float) -> str:
    return datetime.fromtimestamp(time, timezone.utc).strftime('%Y-%m-%d %H:%M:%S UTC')
