"""The counters on the disk: written once a second under power, whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
import json
from pathlib import Path
from typing import Any

from facade_manipulator.files import atomic_write
from facade_manipulator.maintenance.counters import lacking, MachineCounters
from facade_manipulator.maintenance.journal import locked, machine_file

PERIOD = 1.0  # s, so that no kill loses more
GREATEST = ('greatest_following_error', 'serviced')  # no sums
DAMAGES = (OSError, ValueError, TypeError, AttributeError, KeyError)


def _read(path: Path) -> dict[str, Any]:
    """Return the values of a file; raises one of the damages unless they are counters."""
    values = json.loads(path.read_text(encoding='utf-8'))
    MachineCounters.of(values)
    return values


def _backup(path: Path) -> Path:
    return path.with_name(f'.{path.stem}.backup')


def merged(kept: Mapping[str, Any], before: Mapping[str, Any], now: Mapping[str, Any],
           ) -> dict[str, Any]:
    """
    Return the values of a file with what was counted between two readings.

    What another process counted, and what this version does not know, stays; nothing decreases.
    """
    result = dict(kept)
    for name, value in now.items():
        was = before.get(name, {} if isinstance(value, dict) else 0)
        if isinstance(value, dict):
            result[name] = merged(kept.get(name, {}), was, value)
        elif isinstance(value, str):  # what was not changed here may have been elsewhere
            result[name] = value if value != was else kept.get(name, value)
        elif name in GREATEST:
            result[name] = max(kept.get(name, 0), value)
        else:
            result[name] = kept.get(name, 0) + max(value - was, 0)
    return result


def completed(values: Mapping[str, Any], backup: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a file, and of its backup what the file lacks."""
    return {**backup, **{
        name: completed(value, backup.get(name, {})) if isinstance(value, dict) else value
        for name, value in values.items()}}


def kept_counters(folder: str) -> dict[str, MachineCounters]:
    """Return the counters that a folder has by their files' names, those that can be read."""
    found = {}
    for path in sorted(Path(folder).expanduser().glob('counters_*.json')):
        with suppress(*DAMAGES):
            found[path.stem] = MachineCounters.of(_read(path))
    return found


class CounterFile:
    """
    Keep the counters of one machine in a file.

    A disk that hangs or is full costs the counters, nothing else: a thread writes, and what could
    not be written is tried again a second later. In `folder` ``~`` is the user's home, empty keeps
    nothing; the machine's namespace names the file. `counters` are as read from it, new where
    there is none; for one that cannot be read, or that lacks something, there is a backup of when
    the process before began. What other processes counted meanwhile is added. `error` says what is
    wrong.
    """

    def __init__(self, folder: str, machine: str) -> None:
        self._path = machine_file(folder, 'counters', machine, '.json') if folder else None
        self._begun = ''  # what was wrong then
        self._first = self._read()
        self.error = self._begun
        self.counters = MachineCounters.of(self._first)
        self._saved = self.counters.values()
        self._events = self.counters.events
        self._writer = ThreadPoolExecutor(1, 'counters')
        self._job: Future[None] | None = None
        self._next = 0.0

    def keep(self, now: float) -> None:
        """Write the counters at an event, or when they count and it is time [s]; never waits."""
        is_writing = self._job is not None and not self._job.done()
        is_due = self.counters.is_counting and now >= self._next
        if (is_due or self.counters.events != self._events) and not is_writing:
            self._next = now + PERIOD
            self.write()

    def close(self) -> None:
        """Write the counters for the last time."""
        self.write()
        self._writer.shutdown()

    def write(self) -> None:
        """Write the counters as they are; never waits."""
        if self._path is None:
            return
        self._events = self.counters.events
        self._job = self._writer.submit(self._save, self._path, self.counters.values())

    def _save(self, path: Path, values: dict[str, Any]) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with locked(path.parent):
                kept = self._kept(path)
                with atomic_write(path) as draft:
                    draft.write_text(
                        json.dumps(merged(kept, self._saved, values), indent=1), encoding='utf-8')
            self._saved = values
            self.error = self._begun
        except OSError as error:
            self.error = f'the counters are not kept: {path}: {error.strerror or error}'

    def _kept(self, path: Path) -> dict[str, Any]:
        """Return what the file has now, all that was counted here if it cannot be read."""
        try:
            return completed(_read(path), self._first)
        except DAMAGES:
            return completed(self._saved, self._first)

    def _read(self) -> dict[str, Any]:
        """Return the values of the file, completed from its backup, and make the next backup."""
        if self._path is None:
            return {}
        before: dict[str, Any] = {}
        with suppress(*DAMAGES):
            before = _read(_backup(self._path))
        try:
            kept = _read(self._path)
        except FileNotFoundError:
            return before
        except DAMAGES as error:
            aside = self._path.with_suffix('.damaged.json')
            with suppress(OSError):
                self._path.replace(aside)
            begin = f'go on from a backup, {before.get("hours", 0.0):.1f} h' if before else (
                'begin again at 0')
            self._begun = f'the counters {begin}, {aside} could not be read: {error}'
            return before
        values = completed(kept, before)
        if missing := ', '.join(lacking(values)):
            self._begun = (f'{self._path} lacks {missing}, counted from 0 on; '
                           'next: correct the file, or bring back a backup of it')
        with suppress(OSError), atomic_write(_backup(self._path)) as draft:
            draft.write_text(json.dumps(values), encoding='utf-8')
        return values
