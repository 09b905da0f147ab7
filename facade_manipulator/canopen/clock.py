"""Time and waiting of the drive controller; a test passes its own clock."""

from __future__ import annotations

from concurrent.futures import Executor, ThreadPoolExecutor
from threading import Event
import time


class Clock:
    """
    The clocks of this computer, and how threads wait.

    Nothing else in the controller reads a clock, waits or starts a thread, except for the bus,
    which waits for frames.
    """

    monotonic = staticmethod(time.monotonic)  #: time on the monotonic clock [s]
    time = staticmethod(time.time)  #: time on the system clock [s]

    def wait(self, event: Event, timeout: float) -> bool:
        """Wait for an event until a timeout [s]; return whether the event has happened."""
        return event.wait(timeout)

    def workers(self, number: int, name: str) -> Executor:
        """Return an executor with a number of threads."""
        return ThreadPoolExecutor(number, thread_name_prefix=name)
