"""Time and waiting of the drive controller; a test passes a simulated clock."""

from __future__ import annotations

from concurrent.futures import Executor, ThreadPoolExecutor
from threading import Event
import time


class Clock:
    """
    Clocks of this computer, and methods of waiting for threads.

    The controller reads clocks, waits and starts threads only here, except that the bus waits for
    frames.
    """

    monotonic = staticmethod(time.monotonic)  #: time on the monotonic clock [s]
    time = staticmethod(time.time)  #: time on the system clock [s]

    def wait(self, event: Event, timeout: float) -> bool:
        """Wait for an event until a timeout [s]; return whether the event has happened."""
        return event.wait(timeout)

    def workers(self, number: int, name: str) -> Executor:
        """Return an executor with a number of threads."""
        return ThreadPoolExecutor(number, thread_name_prefix=name)
