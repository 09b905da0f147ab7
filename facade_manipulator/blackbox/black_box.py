"""What is kept, when a file is due and what it says of the machine, put together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
import logging
import os
from pathlib import Path
import time
from typing import Any

from facade_manipulator.blackbox import recording
from facade_manipulator.blackbox.messages import RecordedTopic
from facade_manipulator.blackbox.origin import carried_files, host
from facade_manipulator.blackbox.settings import BlackBoxSettings
from facade_manipulator.blackbox.shelf import Shelf
from facade_manipulator.blackbox.stream import Stream
from facade_manipulator.blackbox.trigger import DueFile, RecordTrigger
from facade_manipulator.errors import RecordError
from facade_manipulator.resources import installed_versions, version

Metadata = Mapping[str, Mapping[str, str]]
Parameters = Mapping[str, Mapping[str, Any]]  # by node and name
LONGEST_WRITE = 30.0  # s, for a file
SEGMENT = 3.0  # s, which a loss of power costs; each takes some 5 ms of a processor
LOW_PRIORITY = 10  # nice value of the thread that writes
INTERRUPTED = 'recorder: it was killed or lost power'


class BlackBox:
    """
    Keep messages on the disk, and make a file of them when something stops the machine.

    Whoever owns it adds messages, notes what sources say and lets it `watch`, twice a second at
    least, in one thread; another one writes, so that a disk that hangs holds nobody up. `outcome`
    names the last file.
    `parameters` returns those of the nodes that are known by now; `collect` adds what has come,
    before something is written.
    """

    def __init__(
        self, settings: BlackBoxSettings, namespace: str, topics: Sequence[RecordedTopic],
        parameters: Callable[[], Parameters], collect: Callable[[], object], log: logging.Logger,
    ) -> None:
        self._namespace, self._topics, self._parameters = namespace, topics, parameters
        self._collect, self._duration, self._log = collect, settings.duration, log
        self._trigger = RecordTrigger(settings.duration, settings.aftermath)
        self._shelf = Shelf(settings.folder, settings.disk, namespace)
        self._stream = Stream(  # a file begins before its first reason, and may have later ones
            self._shelf.folder, self._shelf.name, 2 * settings.duration + settings.aftermath,
            round(1e6 * settings.memory), 0.5e6 * settings.disk)
        self.add = self._stream.add
        self._versions = installed_versions()
        self._writer = ThreadPoolExecutor(1, 'black box', lambda: os.setpriority(
            os.PRIO_PROCESS, 0, LOW_PRIORITY))
        self._job: Future[Any] | None = None  # the newest, of a segment or of a file
        self._file: Future[Any] | None = None
        self._flushed = self._job_time = 0.0
        self._chain: tuple[float, Path | None] = 0.0, None
        self._has_recovered = False
        self.outcome = 'nothing recorded yet'
        self._error = ''
        self._files = self._interrupted = 0

    def note(self, source: str, reason: str) -> None:
        """Note why the machine stops by what a source says, or '' while nothing does."""
        if self._trigger.watch(time.monotonic(), source, reason):
            self._flushed = 0.0  # people switch the power off when the machine has stopped

    def watch(self) -> None:
        """Begin to write what is due."""
        now = time.monotonic()
        if not self.is_writing and (due := self._trigger.due(now)) is not None:
            self._record(due)
        elif not self._is_busy and now - self._flushed >= SEGMENT:
            self._collect()
            self._begin(self._flush, self._metadata(self._trigger.reasons))

    def save(self, reason: str) -> Future[Any]:
        """Write a file for a reason, unless another one `is_writing`; the future has its path."""
        return self._record(DueFile((reason,), time.monotonic()))

    @property
    def is_writing(self) -> bool:
        """Return whether a file is being written: a further one would wait for it."""
        return self._file is not None and not self._file.done()

    @property
    def _is_busy(self) -> bool:
        return self._job is not None and not self._job.done()

    @property
    def trouble(self) -> str:
        """Why nothing can be recorded, ``''`` if it can."""
        took = time.monotonic() - self._job_time
        if self._is_busy and took > LONGEST_WRITE:
            return (f'writing a file takes {took:.0f} s, bound {LONGEST_WRITE:g} s: '
                    'does the disk hang?')
        return self._error

    def values(self) -> dict[str, Any]:
        """Return what /diagnostics has of it."""
        return {
            'kept [s]': min(self._stream.span, self._duration),
            'memory [MB]': 1e-6 * self._stream.size,
            'stream [MB]': 1e-6 * self._stream.disk,
            'messages lost': self._stream.dropped,
            'interrupted recordings': self._interrupted,
            'files written': self._files,
            'last file': self.outcome,
            'folder': self._shelf.folder,
        }

    def close(self) -> None:
        """End when what is due, or is being written, is written."""
        if (due := self._trigger.due(float('inf'))) is not None:
            self._record(due)
        self._writer.shutdown()
        if not self._error:
            self._stream.close()

    def _record(self, due: DueFile) -> Future[Any]:
        self._collect()
        self._file = self._begin(self._write, due, self._metadata(due.reasons),
                                 carried_files(self._parameters().get('driver', {})))
        return self._file

    def _begin(self, job: Callable[..., Path | None], *arguments: Any) -> Future[Any]:
        self._flushed = self._job_time = time.monotonic()
        self._job = self._writer.submit(job, *arguments)
        self._job.add_done_callback(self._report)
        return self._job

    def _metadata(self, reasons: tuple[str, ...]) -> Metadata:
        about = {'reasons': '\n'.join(reasons), 'namespace': self._namespace,
                 'version': version(), **host()}
        return {**recording.run_metadata(about, self._parameters()), 'versions': self._versions}

    # --- in the writer's thread

    def _flush(self, metadata: Metadata) -> None:
        """Write what has come to the disk, and before all else what a lost recorder had there."""
        try:
            self._shelf.folder.mkdir(parents=True, exist_ok=True)
            if not self._has_recovered:
                self._interrupted += self._stream.recover(self._recover)
                self._has_recovered = True
            self._shelf.make_room(self._stream.disk)
            self._stream.flush(metadata)
        except OSError as error:
            raise self._shelf.error(error) from error

    def _recover(self, segments: list[Path]) -> None:
        driver = recording.run_parameters(recording.metadata_of(segments[-1])).get('driver', {})
        path = self._shelf.write(
            time.time(), lambda draft: recording.write_recording(
                draft, self._topics, segments, carried_files(driver), INTERRUPTED),
            self._stream.draft())
        self._log.warning(f'{INTERRUPTED}: what it had is in {path}')

    def _write(self, due: DueFile, metadata: Metadata, attachments: Iterable[Path]) -> Path:
        begin = time.monotonic()
        try:
            self._flush(metadata)
            segments = self._stream.since(due.first - self._duration)
            first, over = self._chain
            path = self._shelf.write(
                time.time(), lambda draft: recording.write_recording(
                    draft, self._topics, segments, attachments),
                self._stream.draft(), over if due.first == first else None, self._stream.disk)
        except RecordError:
            self._trigger.again(begin, due)
            raise
        self._chain = due.first, path
        self._trigger.rest(time.monotonic(), time.monotonic() - begin)
        return path

    def _report(self, job: Future[Any]) -> None:
        error = job.exception()
        message = str(error) if error else ''
        if message and message != self._error:
            self._log.error(message)
        self._error = message
        if error is None and job.result() is not None:
            self._files += 1
            self.outcome = f'recorded in {job.result()}'
            self._log.info(self.outcome)
