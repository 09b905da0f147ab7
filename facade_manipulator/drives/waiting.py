"""
Functions with which requests wait for the group, for each drive, or for SDO transfers.

The control loop resumes these generators in each of its turns, also before the cycle has started.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from facade_manipulator.canopen.sdo import Result, Steps
from facade_manipulator.drives.axis import Axis
from facade_manipulator.drives.group_state import GroupState
from facade_manipulator.drives.sdo_access import DriveSteps, SdoAccess
from facade_manipulator.errors import DriveError, joined, NEXT

if TYPE_CHECKING:
    from facade_manipulator.drives.controller import DriveController


def until(controller: DriveController, *states: GroupState) -> Steps[None]:
    """
    Wait until all drives have reached one of the given states of the group.

    Raises a DriveError with the cause if the drives are stopped before that.
    """
    group = controller.group
    while not group.has_done(*states):
        yield
        if group.is_stopped:
            raise DriveError(group.reason)


def until_all(
    controller: DriveController,
    condition: Callable[[Axis], bool],
    timeout: float,
    failure: str,
    remedy: str,
) -> Steps[None]:
    """
    Wait until a condition holds for all axes at the same time.

    Raises a DriveError after the timeout [s]: the error names the axes that do not meet the
    condition, followed by `failure`, such as ``'did not answer'``, and the next step of the
    operator. Unlike `until`, it also waits while the drives are stopped.
    """
    end = controller.now + timeout
    while True:
        missing = [axis.title for axis in controller.axes if not condition(axis)]
        if not missing:
            return
        if controller.now > end:
            drives = ' and '.join(missing)
            raise DriveError(f'{drives} {failure} (waited {timeout:g} s){NEXT}{remedy}')
        yield


# s, for all SDO requests to one drive: 111 answers of 0.2 s each
TURN_TIMEOUT = 25.0


def each(
    controller: DriveController,
    work: Callable[[SdoAccess], Steps[Result]],
    timeout: float | None = None,
) -> Steps[list[Result]]:
    """
    Run the steps of all drives at the same time; return the results by axis.

    No drive is asked after the timeout [s], by default `TURN_TIMEOUT`. Raises a DriveError that
    names the failures of all drives. Raises any other error of a drive unchanged.
    """
    drives = [axis.sdo for axis in controller.axes]
    deadline = controller.now + (timeout or TURN_TIMEOUT)
    try:
        running = [drive.begin(work(drive), deadline) for drive in drives]
        while not all(one.is_done for one in running):
            yield
            for drive in drives:
                drive.resume()
    finally:  # a cancelled request sends nothing more
        for drive in drives:
            drive.end()
    return _results(running)


def _results(ended: Sequence[DriveSteps]) -> list[Result]:
    """Return the results of completed steps; raise all their errors as one error."""
    errors = [one.error for one in ended if isinstance(one.error, DriveError)]
    if len(errors) > 1:
        raise DriveError(joined(*map(str, errors))) from errors[0]
    return [one.result() for one in ended]  # raises the only error
