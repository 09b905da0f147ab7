"""What was done to a machine, and what it ran with: lines of JSON that are only added."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from datetime import datetime
import fcntl
import json
import os
from pathlib import Path
import pwd
from typing import Any

from facade_manipulator.files import sync
from facade_manipulator.resources import machine_name

LIMIT = 1_000_000  # byte, some thousand changes; then the file takes the place of the one before


class Journal:
    """
    Entries of a file, each a line, on the disk before the next step; a former file may be beside.

    A line that a loss of power tore is left out when they are read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._former = path.with_suffix(f'.former{path.suffix}')

    def add(self, **values: Any) -> None:
        """Add an entry with date and the user of this process; raises an OSError."""
        entry = {'date': datetime.now().astimezone().isoformat(' ', 'seconds'), 'user': _user()}
        line = json.dumps({**entry, **values}, ensure_ascii=False).encode() + b'\n'
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with locked(self.path.parent):
            if self.path.exists() and self.path.stat().st_size > LIMIT:
                self.path.replace(self._former)
            with self.path.open('ab+') as file:
                file.write(line if _is_whole(file) else b'\n' + line)
            sync(self.path)
            sync(self.path.parent)

    def step(self, check: str, result: str, passed: bool = True, axis: str = '') -> None:
        """Add what was checked or measured, of an axis or of the machine; raises an OSError."""
        self.add(check=check, axis=axis, passed=passed, result=result)

    def entries(self) -> list[dict[str, Any]]:
        """Return what was added, oldest first; raises an OSError or a ValueError."""
        return [entry for path in (self._former, self.path) if path.exists()
                for entry in _entries(path)]

    def known(self, source: str) -> dict[str, Any]:
        """Return the values that a source had last, by the changes noted."""
        values = {}
        for entry in self.entries():
            if entry.get('source') == source:
                values.update({name: now for name, (_, now) in entry['changed'].items()})
        return values


class ChangeLog:
    """
    Keep what a machine runs with, and every change of it, in a journal beside its counters.

    A disk that hangs or is full costs the entry, nothing else: a thread writes, and `error` says
    what is wrong. In `folder` ``~`` is the user's home; the namespace names the file.
    """

    def __init__(self, folder: str, machine: str) -> None:
        self._journal = Journal(machine_file(folder, 'changes', machine, '.jsonl'))
        self._noted: dict[str, dict[str, Any]] = {}
        self._writer = ThreadPoolExecutor(1, 'changes')
        self.error = ''

    def note(self, source: str, values: Mapping[str, Any]) -> None:
        """Write what differs from what a source had last, also in a run before; never waits."""
        if values != self._noted.get(source, {}):
            self._noted[source] = dict(values)
            self._writer.submit(self._write, source, dict(values))

    def close(self) -> None:
        """End when all is written."""
        self._writer.shutdown()

    def _write(self, source: str, values: dict[str, Any]) -> None:
        try:
            known = self._journal.known(source)
            changed = {name: (known.get(name), value) for name, value in values.items()
                       if name not in known or known[name] != value}
            if changed:
                self._journal.add(source=source, changed=changed)
            self.error = ''
        except (OSError, ValueError) as error:
            self._noted.pop(source, None)  # to be tried again
            self.error = f'changes are not kept: {self._journal.path}: {error}'


def journal_of(parameters: Path) -> Journal:
    """Return the journal beside a parameter file: of commissioning and calibration."""
    return Journal(parameters.with_name(parameters.stem + '.journal.jsonl'))


def machine_file(folder: str, kind: str, machine: str, suffix: str) -> Path:
    """Return the path of a file of a machine by its namespace."""
    return Path(folder).expanduser() / f'{kind}_{machine_name(machine)}{suffix}'


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other processes from writing into this folder meanwhile."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _is_whole(file: Any) -> bool:
    """Return whether a file, at its end, ends with a whole line."""
    if file.seek(0, os.SEEK_END) == 0:
        return True
    file.seek(-1, os.SEEK_END)
    return file.read(1) == b'\n'


def _entries(path: Path) -> list[dict[str, Any]]:
    entries, lines = [], path.read_bytes().splitlines()
    for line in lines:
        with suppress(ValueError):
            entry = json.loads(line)
            entries += [entry] if isinstance(entry, dict) else []
    if lines and not entries:
        raise ValueError(f'{path} is no journal')
    return entries


def _user() -> str:
    try:
        return pwd.getpwuid(os.getuid()).pw_name
    except KeyError:  # one that a container made up
        return str(os.getuid())
