"""What happened when, by the diagnostics of a recording."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from facade_manipulator import diagnostics
from facade_manipulator.blackbox import RecordedRun
from facade_manipulator.diagnostics import LAST_REJECTION, REJECTED
from facade_manipulator.errors import without_numbers
from facade_manipulator.messages import status_level, status_values

OPERATION, STATE = str(diagnostics.OPERATION), diagnostics.OPERATION.key('state')
NOTES = diagnostics.OPERATION.key('notes')
COUNTED = {REJECTED, diagnostics.OPERATION.key('drive faults'), *map(diagnostics.BUS.key, (
    'missed cycles', 'late commands', 'skipped SYNCs', 'error frames', 'worst lateness [ms]'))}
AFTER_STOP = ' after the stop: '  # in the driver's notes of what its drives answered
LONGEST = 40  # events on a page


class Event(NamedTuple):
    """Something that changed at a time [s]."""

    time: float
    text: str
    is_count: bool = False


def statuses(run: RecordedRun) -> Iterator[tuple[float, Any, dict[str, str]]]:
    """Yield time, status and its values of all diagnostics within the recording."""
    for received in run.topics['/diagnostics']:
        if received.time >= run.begin:
            for status in received.message.status:
                yield received.time, status, status_values(status)


def events(run: RecordedRun) -> Iterator[Event]:
    """Yield states, warnings and errors as they begin and end, and what was counted."""
    said: dict[str, tuple[str, str]] = {}
    counts: dict[tuple[str, str], float] = {}
    notes: set[str] = set()
    for time, status, values in statuses(run):
        name, level = status.name.rpartition('/')[2], status_level(status)
        text = values.get(STATE, status.message) if level == 'ok' else status.message
        present = level, without_numbers(text)
        if said.get(name, present if level == 'ok' and name != OPERATION else None) != present:
            yield Event(time, f'{name}: {"" if level == "ok" else level + ": "}{text}')
        said[name] = present
        yield from (Event(time, note) for note in values.get(NOTES, '').split('; ')
                    if AFTER_STOP in note and note not in notes)
        notes.update(values.get(NOTES, '').split('; '))
        if grown := list(_grown(name, values, counts)):
            yield Event(time, f'{name}: {", ".join(grown)}', is_count=True)


def _grown(
    name: str, values: dict[str, str], counts: dict[tuple[str, str], float]
) -> Iterator[str]:
    """Yield counters of a component that have grown, and note all of them."""
    for key in sorted(COUNTED & values.keys()):
        count = float(values[key])
        before = counts.setdefault((name, key), count)
        counts[name, key] = count
        if count > before:
            last = values.get(LAST_REJECTION) if key == REJECTED else ''
            yield f'{key} {before:g} → {count:g}' + (f' ({last})' if last else '')


def timeline(run: RecordedRun, further: list[Event]) -> list[str]:
    """
    Return the events of a recording and further ones, line by line.

    Where there are too many, what was counted is left out first, then the earliest.
    """
    found = sorted([*events(run), *further], key=lambda event: event.time)
    kept = sorted(found, key=lambda event: not event.is_count)[-LONGEST:]
    kept.sort(key=lambda event: event.time)
    left_out = len(found) - len(kept)
    return [*([f'- {left_out} left out, counts first'] if left_out else []),
            *(f'- {event.time - run.begin:.2f} s: {event.text}' for event in kept)]
