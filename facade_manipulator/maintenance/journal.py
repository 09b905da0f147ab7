"""Where the counters of a machine are."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import fcntl
import os
from pathlib import Path

from facade_manipulator.resources import machine_name


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
