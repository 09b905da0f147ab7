"""
The last minute on the bus, written to one file when the drives stop for a fault.

Frames go into a ring of fixed size, which costs no garbage; after a fault a thread of its own
turns it into a zip file with a candump log (``canplayer`` replays it), a table of what each axis
was commanded and did, and the causes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
import csv
from dataclasses import replace
import io
from itertools import count
import logging
from pathlib import Path
import struct
import threading
import time
from typing import NamedTuple
import zipfile

from facade_manipulator.drives.canopen import pdo
from facade_manipulator.drives.cia402 import AXIS_NAMES, AxisSettings, Cause, load_profile
from facade_manipulator.errors import InputError
from facade_manipulator.files import atomic_write
from facade_manipulator.parameters import parameter, settings

FRAME_RATE = 2000  # Hz, that the record has room for: 1 Mbit/s at half load
_RECORD = struct.Struct('<dHB8s')
_PATTERN = 'drive_fault_*.zip'
_log = logging.getLogger(__name__)


@settings
class RecorderSettings:
    """Where and how much is recorded."""

    directory: str = parameter(
        '', 'Folder for the records of faults; empty: none are written', read_only=True)
    duration: float = parameter(
        60.0, 'How long before a fault the record begins', unit='s', minimum=1.0, maximum=600.0,
        read_only=True)
    max_files: int = parameter(
        10, 'Records to keep; the oldest goes when there are more', minimum=1, maximum=1000,
        read_only=True)
    aftermath: float = 1.0  # s, for which the record goes on after a fault; tests shorten it


class Recorded(NamedTuple):
    """A frame with its time on the system clock [s]."""

    stamp: float
    cob_id: int
    data: bytes


class FrameRing:
    """
    The newest frames, in memory that is allocated once; any thread may add to it.

    Parameters
    ----------
    capacity : int
        Frames that it holds.

    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._buffer = bytearray(_RECORD.size * capacity)
        self._next = count()

    def add(self, stamp: float, cob_id: int, data: bytes) -> None:
        """Add a frame over the oldest."""
        slot = next(self._next) % self._capacity
        _RECORD.pack_into(self._buffer, _RECORD.size * slot, stamp, cob_id, len(data), data)

    def copy(self) -> bytes:
        """Return the memory as it is, which is quick; `frames_of` reads it."""
        return bytes(self._buffer)


def frames_of(memory: bytes) -> list[Recorded]:
    """Return the frames in a ring's memory, oldest first."""
    records = (record for record in _RECORD.iter_unpack(memory) if record[0])
    return sorted(
        (Recorded(stamp, cob_id, data[:length]) for stamp, cob_id, length, data in records),
        key=lambda frame: frame.stamp)


def candump_lines(frames: Iterable[Recorded], channel: str) -> Iterator[str]:
    """Yield the frames as ``candump -l`` writes them."""
    for stamp, cob_id, data in frames:
        yield f'({stamp:.6f}) {channel} {cob_id:03X}#{data.hex().upper()}\n'


# columns of the table by mapped object: name, and how an axis turns the raw value into it
_COLUMNS: dict[int, tuple[str, Callable[[AxisSettings, int], object]]] = {
    0x6040: ('controlword', lambda axis, raw: f'{raw:04X}h'),
    0x6060: ('commanded mode', lambda axis, raw: raw),
    0x607A: ('target [m]', lambda axis, raw: f'{axis.to_metres(raw):.6f}'),
    0x6041: ('statusword', lambda axis, raw: f'{raw:04X}h'),
    0x6061: ('mode', lambda axis, raw: raw),
    0x6064: ('position [m]', lambda axis, raw: f'{axis.to_metres(raw):.6f}'),
    0x606C: ('velocity [m/s]', lambda axis, raw: f'{axis.speed_to_metres(raw):.5f}'),
    0x60F4: ('following error [m]', lambda axis, raw: f'{axis.to_metres(raw):.6f}'),
    0x603F: ('error code', lambda axis, raw: f'{raw:04X}h'),
    0x6077: ('force [N]', lambda axis, raw: f'{axis.to_force(raw):.1f}'),
    0x60FD: ('inputs', lambda axis, raw: f'{raw:08X}h'),
}


def axis_table(frames: Iterable[Recorded], axes: tuple[AxisSettings, ...]) -> str:
    """Return a CSV table with a row per SYNC: what each axis was last commanded and last sent."""
    names = [f'{axis} {name}' for axis in AXIS_NAMES for name, _ in _COLUMNS.values()]
    sources = {}
    for name, axis in zip(AXIS_NAMES, axes, strict=True):
        profile = load_profile(axis.profile)
        axis = replace(axis, velocity_unit=profile.velocity_unit)
        sources.update({one.cob_id(axis.node_id): (name, axis, one) for one in profile.pdos})
    text = io.StringIO()
    writer = csv.DictWriter(text, ['time [s]', *names], lineterminator='\n')
    writer.writeheader()
    row: dict[str, object] = {}
    for stamp, cob_id, data in frames:
        if cob_id == pdo.SYNC_COB_ID:
            writer.writerow({'time [s]': f'{stamp:.6f}', **row})
        elif cob_id in sources:
            row.update(_values(*sources[cob_id], data))
    return text.getvalue()


def _values(name: str, axis: AxisSettings, source: pdo.Pdo, data: bytes) -> dict[str, object]:
    try:
        raw = source.unpack(data)
    except InputError:
        return {}
    found = {}
    for index, value in zip(source.indices, raw, strict=True):
        if index in _COLUMNS:
            column, convert = _COLUMNS[index]
            found[f'{name} {column}'] = convert(axis, value)
    return found


class FaultRecorder:
    """
    Keep the newest frames and write them down when a fault has stopped the drives.

    Parameters
    ----------
    settings : RecorderSettings
    axes : tuple of AxisSettings
    channel : str
        Name of the bus in the candump log.

    """

    def __init__(
        self, settings: RecorderSettings, axes: tuple[AxisSettings, ...], channel: str = 'can0'
    ) -> None:
        self.last_outcome = ''
        self._settings = settings
        self._axes = axes
        self._channel = channel
        self._ring = FrameRing(round(settings.duration * FRAME_RATE))
        self.add = self._ring.add  # keeps a frame: called for each that is received or sent
        self._causes: tuple[Cause | str, ...] = ()
        self._due: float | None = None

    @property
    def is_on(self) -> bool:
        """Return whether there is a folder to write to."""
        return bool(self._settings.directory)

    def watch(self, causes: tuple[Cause | str, ...], now: float) -> None:
        """
        Begin a record when there are causes where there were none; write it when it is due.

        Never waits: a thread of its own writes.

        """
        if causes and not self._causes and self.is_on:
            self._due = now + self._settings.aftermath
        if causes or self._due is None:
            self._causes = causes
        if self._due is not None and now >= self._due:
            self._due = None
            threading.Thread(
                target=self._write,
                args=(self._ring.copy(), tuple(map(str, self._causes)), time.time()),
                name='drive fault record', daemon=True).start()

    def _write(self, memory: bytes, causes: tuple[str, ...], stamp: float) -> None:
        """Write a record and drop the oldest; a full disk costs the record, nothing else."""
        label = time.strftime('%Y%m%d_%H%M%S', time.localtime(stamp))
        path = Path(self._settings.directory).expanduser() / f'drive_fault_{label}.zip'
        try:
            self._write_archive(path, frames_of(memory), causes)
            self._drop_oldest(path.parent)
        except Exception as error:  # who else would notice that this thread has ended?
            self.last_outcome = (
                f'the record of the fault could not be written: {type(error).__name__}: {error}')
            _log.error(self.last_outcome)
        else:
            self.last_outcome = f'the fault is recorded in {path}'
            _log.info(self.last_outcome)

    def _write_archive(
        self, path: Path, frames: list[Recorded], causes: tuple[str, ...]
    ) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        with (atomic_write(path) as draft,
              zipfile.ZipFile(draft, 'w', zipfile.ZIP_DEFLATED) as archive):
            for name, content in (
                ('causes.txt', '\n'.join(causes) + '\n'),
                ('candump.log', ''.join(candump_lines(frames, self._channel))),
                ('axes.csv', axis_table(frames, self._axes)),
            ):  # without the time of this clock: a zip file has none before 1980
                archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)

    def _drop_oldest(self, folder: Path) -> None:
        records = sorted(folder.glob(_PATTERN))
        for path in records[:-self._settings.max_files]:
            path.unlink(missing_ok=True)
