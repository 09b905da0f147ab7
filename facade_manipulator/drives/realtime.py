"""
Keep the control loop on time: scheduling, memory, CPU, garbage collection.

What the system rejects is reported in a message with the command that grants it; the loop runs on
without.
"""

from __future__ import annotations

import ctypes
import gc
import math
import os
import sys

from facade_manipulator.drives.controller_settings import ControllerSettings

_MCL_CURRENT, _MCL_FUTURE = 1, 2
_SWITCH_INTERVAL = 0.0005  # s: the interpreter's own is longer than a step may wait
PERMISSION = ('"ulimit -r" of it: LimitRTPRIO=99 in its systemd service, or "@realtime - '
              'rtprio 99" in /etc/security/limits.d')
YOUNG_COLLECTION, FULL_COLLECTION = 1, 2
COLLECTION_PERIOD = 1.0  # s
FULL_EVERY = 10


def request_realtime(settings: ControllerSettings) -> list[str]:
    """Ask for what the settings say for the calling thread; return what was rejected."""
    priority, cpu, rejected = settings.realtime_priority, settings.cpu, list[str]()
    try:
        if priority > 0:  # not for the threads that this one starts: they have no deadline
            os.sched_setscheduler(
                0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError as error:
        rejected.append(f'SCHED_FIFO with priority {priority} is rejected ({error.strerror}): it '
                        f'needs {PERMISSION}')
    try:
        if cpu >= 0:
            os.sched_setaffinity(0, {cpu})
    except (OSError, ValueError) as error:
        rejected.append(f'the control thread cannot be bound to CPU {cpu} ({error}): this machine '
                        f'has {os.cpu_count()} CPUs')
    if priority > 0 and ctypes.CDLL(None, use_errno=True).mlockall(
            _MCL_CURRENT | _MCL_FUTURE):
        reason = os.strerror(ctypes.get_errno())
        rejected.append(f'the memory cannot be locked ({reason}): grant it with "@realtime - '
                        'memlock unlimited" in /etc/security/limits.d')
    return rejected


def realtime_priority() -> int:
    """Return the real-time priority of the calling thread, 0 for none."""
    policy = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
    is_realtime = policy in (os.SCHED_FIFO, os.SCHED_RR)
    return os.sched_getparam(0).sched_priority if is_realtime else 0


def describe_scheduling(priority: int) -> str:
    """Return in one line how the control loop is scheduled, and how to do better."""
    if priority > 0:
        return f'the control loop runs with real-time scheduling, priority {priority}'
    return ('the control loop runs without real-time scheduling: other programs can hold it up '
            f'until the drives stop; set controller.realtime_priority, which needs {PERMISSION}')


class GarbageCollectionPause:
    """
    Run the garbage collector where it costs no cycle.

    While in force, the automatic collection of the process is off, and what lived before is
    never looked at again. Also lets threads of the process change places more often than by
    default, since the control thread must get the interpreter within a fraction of its period.

    Attributes
    ----------
    due : float
        When to call `collect` next, in the slack of a cycle whose commands are out [s].

    """

    def __init__(self) -> None:
        self.due = math.inf
        self._collections = 0
        self._before: tuple[bool, float] | None = None

    def start(self) -> None:
        """Take over; harmless when in force already."""
        if self._before is None:
            self._before = gc.isenabled(), sys.getswitchinterval()
            gc.disable()
            gc.collect()
            gc.freeze()
            sys.setswitchinterval(min(_SWITCH_INTERVAL, self._before[1]))
            self.due = 0.0

    def keep(self) -> None:
        """Never look again at what lives now; takes no time, and changes nothing when off."""
        if self._before is not None:
            gc.freeze()

    def stop(self) -> None:
        """Give back; harmless when not in force."""
        if self._before is not None:
            was_enabled, interval = self._before
            self._before = None
            self.due = math.inf
            gc.unfreeze()
            sys.setswitchinterval(interval)
            if was_enabled:
                gc.enable()

    def collect(self, now: float) -> None:
        """Collect a little, every now and then all."""
        self.due = now + COLLECTION_PERIOD
        self._collections += 1
        gc.collect(YOUNG_COLLECTION if self._collections % FULL_EVERY else FULL_COLLECTION)
