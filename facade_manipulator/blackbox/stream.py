"""What came in the last minutes: on the disk in segments, the newest seconds in memory."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping
import fcntl
import os
from pathlib import Path
import shutil
import sys
import tempfile
import threading
import time
from typing import Any, NamedTuple

from facade_manipulator.blackbox.can_frames import CAN_TOPIC
from facade_manipulator.blackbox.messages import packed, time_of
from facade_manipulator.blackbox.recording import segment_messages, SUMMARY, write_segment
from facade_manipulator.files import atomic_write

Metadata = Mapping[str, Mapping[str, str]]
OVERHEAD = sys.getsizeof(b'') + 8  # bytes that a packed message takes beside its own


class Segment(NamedTuple):
    """A few seconds on the disk, complete in itself, on the monotonic clock [s]."""

    path: Path
    begin: float
    end: float
    size: int  #: [byte]


class Stream:
    """
    Keep messages of the last `duration` [s], so that neither a kill nor a power cut takes them.

    Any thread may `add`; one thread does the rest. Messages wait in `memory` [byte], their objects
    included, until `flush` writes them as a segment; each begins with the newest message of every
    topic before it. While the disk takes none, the oldest in memory go and are `dropped`. Segments
    take at most `disk` [byte]. They are in a folder below `folder` whose lock says that the stream
    lives.
    """

    def __init__(
        self, folder: Path, name: str, duration: float, memory: int, disk: float,
    ) -> None:
        self._root, self._name = folder, f'.stream_{name}_'
        self._duration, self._memory, self._disk = duration, memory, disk
        self._waiting: deque[bytes] = deque()
        self._newest: dict[str, bytes] = {}  # of each topic
        self._earlier: list[bytes] = []  # those of them before the next segment
        self._lock = threading.Lock()
        self._folder: Path | None = None
        self._lock_file = -1
        self._count = 0
        self._segments: list[Segment] = []
        self.size = 0  #: memory of messages that wait [byte]
        self.dropped = 0

    @property
    def span(self) -> float:
        """Time from the oldest segment's begin until now [s]."""
        return time.monotonic() - self._segments[0].begin if self._segments else 0.0

    @property
    def disk(self) -> int:
        """Space of the segments [byte]."""
        return sum(segment.size for segment in self._segments)

    def add(self, topic: str, messages: Iterable[tuple[float, bytes]]) -> None:
        """Add messages of a topic, each with the monotonic time at which it came [s]."""
        records = packed(topic, messages)
        with self._lock:
            self._waiting.extend(records)
            self.size += _size(records)
            if records and topic != CAN_TOPIC.topic:
                self._newest[topic] = records[-1]
            while self.size > self._memory and self._waiting:
                self.size -= _size([self._waiting.popleft()])
                self.dropped += 1

    def flush(self, metadata: Metadata) -> None:
        """
        Write what waits as a segment; raises an OSError, and keeps it, if that fails.

        Metadata are those of the file that would be made of the segments now.
        """
        with self._lock:
            records, self._waiting = self._waiting, deque()
            newest = list(self._newest.values())
        try:
            self._segments.append(self._write(list(records), metadata))
        except OSError:
            with self._lock:
                records.extend(self._waiting)
                self._waiting = records
            raise
        with self._lock:
            self.size -= _size(records)
        self._earlier = newest
        self._forget(time.monotonic() - self._duration)

    def _write(self, records: list[bytes], metadata: Metadata) -> Segment:
        times = [time_of(one) for one in records] or [time.monotonic()]
        begin, end = min(times), max(times)
        summary = {**metadata[SUMMARY], 'begin': repr(begin),
                   'epoch': repr(time.time() - time.monotonic())}
        path = self._open() / f'{self._count:08}.mcap'
        with atomic_write(path) as draft:
            write_segment(draft, self._earlier, records, begin, {**metadata, SUMMARY: summary})
        self._count += 1
        return Segment(path, begin, end, path.stat().st_size)

    def _forget(self, oldest: float) -> None:
        while self._segments[1:] and (
                self._segments[0].end < oldest or self.disk > self._disk):
            self._segments.pop(0).path.unlink(missing_ok=True)

    def _open(self) -> Path:
        if self._folder is None:
            self._root.mkdir(parents=True, exist_ok=True)
            folder = Path(tempfile.mkdtemp(prefix=self._name, dir=self._root))
            self._lock_file = _lock(folder)
            self._folder = folder
        return self._folder

    def draft(self) -> Path:
        """Return a path for a draft, which goes with the stream."""
        return self._open() / 'draft'

    def since(self, begin: float) -> list[Path]:
        """Return the segments that have what came since a monotonic time [s]."""
        return [segment.path for segment in self._segments if segment.end >= begin]

    def close(self) -> None:
        """Delete the segments."""
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
            os.close(self._lock_file)
            self._folder = None

    def recover(self, write: Callable[[list[Path]], Any]) -> int:
        """Let `write` make a file of each stream that ended without `close`; return how many."""
        abandoned = 0
        for folder in sorted(self._root.glob(f'{self._name}*')):
            if folder == self._folder or (lock := _lock(folder)) < 0:
                continue
            try:
                if segments := [path for path in sorted(folder.glob('*.mcap')) if _is_whole(path)]:
                    write(segments)
                shutil.rmtree(folder)
                abandoned += 1
            finally:
                os.close(lock)
        return abandoned


def _lock(folder: Path) -> int:
    """Return the descriptor that holds the lock of a folder; -1 if a living process has it."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        return -1
    return descriptor


def _is_whole(path: Path) -> bool:
    """Return whether a segment can be read; a bad disk may keep half of one."""
    try:
        segment_messages(path, True)
    except Exception:  # damaged bytes raise whatever their decoder does
        return False
    return True


def _size(records: Collection[bytes]) -> int:
    return sum(map(len, records)) + OVERHEAD * len(records)
