"""Detection of a silent drive: missing answers to SYNC, or missing heartbeats."""

from __future__ import annotations

from math import inf

from facade_manipulator.drives.answers import Answers
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.node_monitor import NodeMonitor
from facade_manipulator.drives.snapshot import Cause, Remedy
from facade_manipulator.errors import compared


class Silence:
    """
    Supervisor of one drive's answers and heartbeats.

    The exchange asks for a `new_cause` of a stop in each cycle, after `begin`. A snapshot asks for
    the `cause` at any time after the first heartbeat. Times are on the monotonic clock [s].
    """

    def __init__(
        self,
        name: str,
        title: str,
        answers: Answers,
        node: NodeMonitor,
        settings: ControllerSettings,
    ) -> None:
        #: whether the drive was silent, so that it may have restarted unnoticed
        self.is_lost = False
        self._name = name
        self._title = title
        self._answers = answers
        self._node = node
        self._settings = settings
        self._since = -inf  # silence before this time does not count [s]
        # whether missing answers are excused until the next answer
        self._may_miss = False

    def begin(self, now: float) -> None:
        """Treat silence as a fault from a time [s]."""
        self._since = now
        self.is_lost = False

    def excuse(self, now: float) -> None:
        """
        Excuse silence and missing answers before a time [s].

        The frames were not read, or were dropped from a full queue.
        """
        self._since = now

    def excuse_answers(self) -> None:
        """Excuse missing answers until the next answer, because the NMT state will change."""
        self._may_miss = True

    def lose(self) -> None:
        """Record that the drive was silent; do not report its silence again."""
        self.is_lost = True

    def cause(self, now: float) -> Cause | None:
        """Return the cause of a stop if answers or heartbeats are missing at a time [s]."""
        missed = self._answers.missed_in_a_row
        most_missed = self._settings.max_missed_cycles
        age = self._heartbeat_age(now)
        timeout = self._settings.heartbeat_timeout
        if missed >= most_missed:
            failure = (
                f'did not answer {missed} cycles in a row, '
                f'the limit is {most_missed} (controller.max_missed_cycles)'
            )
        elif age > timeout:
            silence, limit = compared(1e3 * age, 1e3 * timeout, '.0f')
            failure = (
                f'sent no heartbeat for {silence} ms, '
                f'above the limit {limit} ms (controller.heartbeat_timeout)'
            )
        else:
            return None
        return Cause(
            f'{self._title} {failure}',
            Remedy.CONFIGURE,
            self._name,
            configure_again=True,
            is_vague=True,
        )

    def new_cause(self, now: float) -> Cause | None:
        """
        Return the cause of a new silence at a time [s], None for a drive already lost.

        A drive in an NMT state other than operational answers no SYNC.
        """
        if not self._answers.missed_in_a_row:
            self._may_miss = False
        may_miss = self._may_miss or self._node.commanded != 'OPERATIONAL'
        if now < self._since and not may_miss:
            self._answers.excuse()
        has_heartbeat = self._heartbeat_age(now) <= self._settings.heartbeat_timeout
        if self.is_lost or (may_miss and has_heartbeat):
            return None
        return self.cause(now)

    def _heartbeat_age(self, now: float) -> float:
        return now - max(self._node.heartbeat_time or 0.0, self._since)
