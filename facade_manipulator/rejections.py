"""Rejected messages of an input, so that they are distinguished from a silent sender."""

from __future__ import annotations

import math

from facade_manipulator.errors import ManipulatorError


class Rejections:
    """Series of rejected messages by reason, since the newest valid message of an input."""

    PAUSE = 2.0  # s without a rejection, after which the sender counts as silent

    def __init__(self) -> None:
        # by reason: message, time of the newest rejection [s]
        self._series: dict[str, tuple[str, float]] = {}

    def add(self, now: float, error: ManipulatorError) -> None:
        """
        Add a rejection at a time [s]; a series stores the message of its first rejection.

        A series due to a second publisher stores the newest message, because the name of that
        publisher may arrive later.
        """
        reason = getattr(error, 'reason', 'other')
        message, newest = self._series.get(reason, ('', -math.inf))
        if reason == 'publishers':
            message = str(error)
        if now - newest > self.PAUSE:
            self._series.pop(reason, None)  # another series, after those that continue
            message = str(error)
        self._series[reason] = message, now

    def clear(self) -> None:
        """End all series, because a valid message was received."""
        self._series.clear()

    def message(self, now: float) -> str:
        """
        Return the message of the oldest current series at a time [s], or ``''``.

        Messages that differ in a measured value do not change the message of their series, so
        that a report is published once.
        """
        for message, newest in self._series.values():
            if now - newest <= self.PAUSE:
                return message
        return ''
