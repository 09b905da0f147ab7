"""
Real-time behaviour of a process: scheduling, memory, CPU and garbage collection.

A request that the system rejects is reported with the setting that grants it; the process runs
without it.

The default priorities are below 50, which the kernel gives to its interrupt threads. A process
that runs too long without a pause returns to the normal scheduler, and is killed if it cannot.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import ctypes
import gc
import logging
import os
import resource
import signal
import sys

from facade_manipulator.drives.controller_settings import ControllerSettings

LONGEST_RUN = 1  # s without a pause, after which a process loses its priority
_PERMISSION = (
    'LimitRTPRIO=99 in the systemd service, or "@realtime - rtprio 99" in '
    '/etc/security/limits.d'
)
#: action of an operator whose control loop has no priority
PERMIT_PRIORITY = (
    f'set controller.realtime_priority above 0, and permit it with {_PERMISSION}'
)
NO_PRIORITY = (
    'the control loop runs without real-time scheduling: other programs can delay it until the '
    f'drives stop; next: {PERMIT_PRIORITY}'
)
_log = logging.getLogger(__name__)


def request_realtime(settings: ControllerSettings) -> list[str]:
    """
    Apply the settings of priority, locked memory and CPU; return a message for each rejection.

    The priority applies to all present threads of this process. The CPU applies to the calling
    thread, and to threads that it starts later.
    """
    priority = settings.realtime_priority
    cpu = settings.cpu
    rejections = []
    if priority > 0:
        rejections += _rejection(
            lambda: set_priority(priority),
            f'SCHED_FIFO with priority {priority} is rejected: it needs {_PERMISSION}',
        )
        # Without a priority, other programs delay the loop more than pages that must be loaded.
        if not rejections:
            rejections += _rejection(
                _lock_memory,
                'the memory cannot be locked: it needs LimitMEMLOCK=infinity in the systemd '
                'service, or "@realtime - memlock unlimited" in /etc/security/limits.d',
            )
    if cpu >= 0:
        rejections += _rejection(
            lambda: os.sched_setaffinity(0, {cpu}),
            f'the control loop cannot be bound to CPU {cpu}: this machine has '
            f'{os.cpu_count()} CPUs',
        )
    return rejections


def _rejection(request: Callable[[], None], message: str) -> list[str]:
    """Execute a request to the system; return a list with its rejection, or an empty list."""
    try:
        request()
    except (OSError, ValueError) as error:
        return [f'{message} ({error})']
    return []


#: of a node: below that of the control loop, which must never wait for a node
NODE_PRIORITY = 15


def request_node_priority() -> None:
    """
    Request a priority for the process of a node, unless it was started with one.

    The nodes work without this priority. The control loop logs the setting that the system must
    permit.
    """
    if realtime_priority():
        return
    with suppress(OSError, ValueError):
        set_priority(NODE_PRIORITY)


KILL_TIME = 3  # s without a pause, after which the kernel kills the process


def set_priority(priority: int) -> None:
    """
    Give all present threads of this process a SCHED_FIFO priority that new threads do not inherit.

    All threads wait for the lock of the interpreter, so that a thread without priority would
    delay the others. Raises an OSError if the system does not permit the priority. Raises a
    ValueError outside the main thread, or if the limit on the time without a pause may not be set.
    After an error, no thread has the priority.
    """
    # Set the limit first; it has no effect until a thread has a priority. If the limit is
    # rejected, no thread has a priority.
    signal.signal(signal.SIGXCPU, _give_up_priority)
    microseconds = 1_000_000
    resource.setrlimit(
        resource.RLIMIT_RTTIME,
        (LONGEST_RUN * microseconds, KILL_TIME * microseconds),
    )
    _schedule(os.SCHED_FIFO, priority)


def _schedule(policy: int, priority: int) -> None:
    """Apply a scheduling policy and priority to all threads of this process."""
    for thread in os.listdir('/proc/self/task'):
        with suppress(ProcessLookupError):  # the thread has just ended
            os.sched_setscheduler(
                int(thread),
                policy | os.SCHED_RESET_ON_FORK,
                os.sched_param(priority),
            )


def clear_priority() -> None:
    """Return all threads of this process to normal scheduling."""
    _schedule(os.SCHED_OTHER, 0)


def _give_up_priority(*_: object) -> None:
    """Return to normal scheduling after `LONGEST_RUN` without a pause."""
    clear_priority()
    _log.error(
        'this process ran for %d s without a pause and gave up its real-time priority; '
        'next: report this',
        LONGEST_RUN,
    )


_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4


def _lock_memory() -> None:
    """Lock each memory page of this process when the page is first used."""
    flags = _MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT
    if ctypes.CDLL(None, use_errno=True).mlockall(flags):
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))


def realtime_priority() -> int:
    """Return the real-time priority of the calling thread, 0 without real-time scheduling."""
    return os.sched_getparam(0).sched_priority


# s: a step may not wait for the interpreter's default of 5 ms
_SWITCH_INTERVAL = 0.0005


def take_over_collector() -> None:
    """
    Disable automatic garbage collection; `freeze_objects` and `collect_garbage` replace it.

    Threads then take turns more often than by default, because the control loop must get the
    interpreter within a fraction of its period.
    """
    gc.disable()
    sys.setswitchinterval(_SWITCH_INTERVAL)


def freeze_objects() -> None:
    """Collect garbage and exclude the present objects from collections until `gc.unfreeze`."""
    if not gc.isenabled():
        gc.collect()
        gc.freeze()


def collect_garbage() -> None:
    """Collect new garbage in the idle time of a cycle."""
    if not gc.isenabled():
        gc.collect()
