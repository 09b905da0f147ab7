"""The counters on the disk: written once a second while there is power, whole or not at all."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
import json
from pathlib import Path
import re

from facade_manipulator.files import atomic_write
from facade_manipulator.maintenance.counters import MachineCounters

PERIOD = 1.0  # s, so that no kill loses more
DAMAGES = (OSError, ValueError, TypeError, AttributeError, KeyError)


def _read(path: Path) -> MachineCounters:
    return MachineCounters.of(json.loads(path.read_text(encoding='utf-8')))


def kept_counters(folder: str) -> dict[str, MachineCounters]:
    """Return the counters that a folder has by their files' names, those that can be read."""
    found = {}
    for path in sorted(Path(folder).expanduser().glob('counters_*.json')):
        with suppress(*DAMAGES):
            found[path.stem] = _read(path)
    return found


class CounterFile:
    """
    Keep the counters of one machine in a file.

    A disk that hangs or is full costs the counters, nothing else: a thread writes, and what could
    not be written is tried again a second later. In `folder` ``~`` is the user's home, empty keeps
    nothing; the machine's namespace names the file. `counters` are as read from it, new where
    there is none; one that cannot be read is put aside. `error` says what is wrong with it.
    """

    def __init__(self, folder: str, machine: str) -> None:
        name = re.sub(r'\W', '_', machine.strip('/')) or 'manipulator'
        self._path = Path(folder).expanduser() / f'counters_{name}.json' if folder else None
        self.error = ''
        self.counters = self._read()
        self._writer = ThreadPoolExecutor(1, 'counters')
        self._job: Future | None = None
        self._next = 0.0

    def keep(self, now: float) -> None:
        """Write the counters if they count and it is time [s]; never waits."""
        is_writing = self._job is not None and not self._job.done()
        if self.counters.is_counting and now >= self._next and not is_writing:
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
        self._job = self._writer.submit(self._save, json.dumps(self.counters.values(), indent=1))

    def _save(self, text: str) -> None:
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_write(self._path) as draft:
                draft.write_text(text, encoding='utf-8')
            self.error = ''
        except OSError as error:
            self.error = f'the counters are not kept: {self._path}: {error.strerror or error}'

    def _read(self) -> MachineCounters:
        if self._path is None:
            return MachineCounters()
        try:
            return _read(self._path)
        except FileNotFoundError:
            return MachineCounters()
        except DAMAGES as error:
            aside = self._path.with_suffix('.damaged.json')
            with suppress(OSError):
                self._path.replace(aside)
            self.error = f'the counters begin again at 0, {aside} could not be read: {error}'
            return MachineCounters()
