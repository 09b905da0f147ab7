"""
Keep the control loop on time: scheduling, memory, CPU, garbage collection.

A request that the system rejects is reported with the setting that grants it; the loop runs
without it.
"""

from __future__ import annotations

from collections.abc import Callable
import ctypes
import gc
import math
import os
import sys

from facade_manipulator.drives.controller_settings import ControllerSettings

_MCL_CURRENT, _MCL_FUTURE = 1, 2
_SWITCH_INTERVAL = 0.0005  # s: a step may not wait for the interpreter's default of 5 ms
PERMISSION = ('"ulimit -r" of it: LimitRTPRIO=99 in its systemd service, or "@realtime - '
              'rtprio 99" in /etc/security/limits.d')
COLLECTION_PERIOD = 1.0  # s


def request_realtime(settings: ControllerSettings) -> list[str]:
    """Request the scheduling of the settings for the calling thread; return the rejections."""
    priority, cpu = settings.realtime_priority, settings.cpu
    rejections = []

    def attempt(act: Callable[[], object], rejection: str) -> None:
        try:
            act()
        except (OSError, ValueError) as error:
            rejections.append(f'{rejection} ({error})')

    if priority > 0:  # not of the threads that this one starts: they have no deadline
        attempt(lambda: os.sched_setscheduler(
            0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority)),
            f'SCHED_FIFO with priority {priority} is rejected: it needs {PERMISSION}')
        attempt(_lock_memory, 'the memory cannot be locked: grant it with "@realtime - memlock '
                'unlimited" in /etc/security/limits.d')
    if cpu >= 0:
        attempt(lambda: os.sched_setaffinity(0, {cpu}), f'the control thread cannot be bound to '
                f'CPU {cpu}: this machine has {os.cpu_count()} CPUs')
    return rejections


def _lock_memory() -> None:
    if ctypes.CDLL(None, use_errno=True).mlockall(_MCL_CURRENT | _MCL_FUTURE):
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))


def realtime_priority() -> int:
    """Return the real-time priority of the calling thread, 0 for none."""
    policy = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
    is_realtime = policy in (os.SCHED_FIFO, os.SCHED_RR)
    return os.sched_getparam(0).sched_priority if is_realtime else 0


def describe_scheduling(priority: int) -> str:
    """Return the scheduling of the control loop in one line, with the way to improve it."""
    if priority > 0:
        return f'the control loop runs with real-time scheduling, priority {priority}'
    return ('the control loop runs without real-time scheduling: other programs can hold it up '
            f'until the drives stop; set controller.realtime_priority, which needs {PERMISSION}')


class GarbageCollectionPause:
    """
    Run the garbage collector of this process only where it delays no cycle.

    `due` is the time of the next `collect` [s], in the slack of a cycle whose commands are out.
    Objects from before are never examined again, so that a collection takes little time. Threads
    take turns more often than by default, because the control thread must get the interpreter
    within a fraction of its period.
    """

    def __init__(self) -> None:
        self.due = math.inf

    def start(self) -> None:
        """Take over from the automatic collection."""
        gc.disable()
        gc.collect()
        gc.freeze()
        sys.setswitchinterval(_SWITCH_INTERVAL)
        self.due = 0.0

    def keep(self) -> None:
        """Never examine the present objects again; changes nothing when off."""
        if self.due < math.inf:
            gc.freeze()

    def stop(self) -> None:
        """Give back to the automatic collection; harmless when off."""
        if self.due < math.inf:
            self.due = math.inf
            gc.unfreeze()
            gc.enable()

    def collect(self, now: float) -> None:
        """Collect the garbage since the last time [s]."""
        self.due = now + COLLECTION_PERIOD
        gc.collect()
