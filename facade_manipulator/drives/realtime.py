"""
Timing of the control loop: scheduling, memory, CPU and garbage collection.

A request that the system rejects is reported with the setting that grants it; the loop runs
without it.
"""

from __future__ import annotations

import ctypes
import gc
import os
import sys

from facade_manipulator.drives.controller_settings import ControllerSettings

_MCL_CURRENT, _MCL_FUTURE = 1, 2
_SWITCH_INTERVAL = (
    0.0005  # s: a step may not wait for the interpreter's default of 5 ms
)
_PERMISSION = (
    '"ulimit -r" of at least this priority: set LimitRTPRIO=99 in the systemd service, '
    'or "@realtime - rtprio 99" in /etc/security/limits.d'
)
NO_PRIORITY = (
    'the control loop runs without real-time scheduling: other programs can delay it until the '
    f'drives stop; next: set controller.realtime_priority, which needs {_PERMISSION}'
)


def request_realtime(settings: ControllerSettings) -> list[str]:
    """Request the scheduling of the settings for the calling thread; return the rejections."""
    priority, cpu = settings.realtime_priority, settings.cpu
    # the threads that this one starts have no deadline
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    rejections = []
    for is_wanted, request, rejection in (
        (
            priority > 0,
            lambda: os.sched_setscheduler(0, policy, os.sched_param(priority)),
            f'SCHED_FIFO with priority {priority} is rejected: it needs {_PERMISSION}',
        ),
        (
            priority > 0,
            _lock_memory,
            'the memory cannot be locked: grant it with "@realtime - '
            'memlock unlimited" in /etc/security/limits.d',
        ),
        (
            cpu >= 0,
            lambda: os.sched_setaffinity(0, {cpu}),
            'the control loop cannot be '
            f'bound to CPU {cpu}: this machine has {os.cpu_count()} CPUs',
        ),
    ):
        try:
            if is_wanted:
                request()
        except (OSError, ValueError) as error:
            rejections.append(f'{rejection} ({error})')
    return rejections


def _lock_memory() -> None:
    if ctypes.CDLL(None, use_errno=True).mlockall(_MCL_CURRENT | _MCL_FUTURE):
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))


def realtime_priority() -> int:
    """Return the real-time priority of the calling thread, 0 for none."""
    return os.sched_getparam(0).sched_priority


def take_over_collector() -> None:
    """
    Disable automatic garbage collection, which `freeze_objects` and `collect_garbage` replace.

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
    """Collect the garbage since the last collection, in the slack of a cycle."""
    if not gc.isenabled():
        gc.collect()
