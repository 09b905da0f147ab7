"""Two drivers that configure on one bus at the same time."""

from __future__ import annotations

import time

from drive_rig import PATIENCE, Rig, SETTINGS, Source
import pytest

from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.controller import DriveController
from facade_manipulator.drives.session import BusAccess, Session
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.states import State
from facade_manipulator.drives.targets import MechanismChecks


@pytest.fixture
def rig(simulated_time):
    """Make one drive controller with simulated drives on a virtual bus."""
    made = Rig('two drivers')
    yield made
    made.close()


@pytest.mark.parametrize('delay', [0.0, 0.01, 0.03, 0.05, 0.1, 0.3])
def test_two_drivers_that_configure_together_exclude_each_other(rig, delay):
    """Each finds the other on the bus, without the ROS graph."""
    second = DriveController(Session(
        SETTINGS, DEFAULT_AXES, BusAccess(rig.open_bus), MechanismChecks(Source())))
    second.start()
    jobs = [rig.controller.request('configure')]
    time.sleep(delay)  # s; each listens for two heartbeats before its first frame
    jobs.append(second.request('configure'))
    errors = [error for job in jobs if (error := job.exception(PATIENCE)) is not None]
    assert errors
    assert all('another master uses this bus' in str(error) for error in errors)
    if len(errors) == 1:
        loser = next(job for job in jobs if job.exception() is not None)
        assert loser is jobs[1] and rig.state is ControllerState.INACTIVE
        rig.do('home', 'activate')
        assert rig.drive_states == [State.OPERATION_ENABLED] * 3
    second.close()
