"""Failures of any of three drives in any motion, in which no carriage touches its neighbour."""

from dataclasses import replace
import math
import random
from typing import NamedTuple

from bus_world import axes_at, ignore_targets, in_motion, Rig, SETTINGS
from drive_faults import half_following
import pytest

from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.kinematics import Geometry
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.simulation.drives.drive import SimulatedDrive
from facade_manipulator.simulation.drives.motor import SimulationSettings

pytestmark = pytest.mark.long

LAGS = (0.0, 0.005, 0.015, 0.025, 0.035)  # s
WATCHED = 0.8  # s
TOUCHING = Geometry().carriage_length
# seeds of the motions in which neighbours come nearest to each other
NEAREST = [99, 43, 4, 12, 73, 97, 44, 15, 3, 24, 7, 83, 13, 92]


def seize(drive):
    """Hold a carriage at its place against its drive."""
    drive.motor.velocity = 0.0
    drive.motor.follow = lambda *_: None


def die(drive):
    seize(drive)
    drive.is_silent = True


FAILURES = (die, seize, lambda drive: drive.inject_fault(0x8A82))


class Wave(NamedTuple):
    """Oscillation that starts at the offset zero."""

    size: float  # m
    rate: float  # rad/s
    phase: float  # rad

    def offset(self, time):
        """Return the offset [m] at a time [s]."""
        turn = math.sin(self.rate * time + self.phase) - math.sin(self.phase)
        return self.size * turn

    def speed(self, time):
        """Return the speed [m/s] at a time [s]."""
        return self.size * self.rate * math.cos(self.rate * time + self.phase)


def random_wave(chance):
    size = chance.uniform(0.0, 0.2)
    rate = chance.uniform(0.5, 5.0)
    phase = chance.uniform(0.0, 6.3)
    return Wave(size, rate, phase)


def swing(chance):
    """Oscillate the carriages, each separately and all together."""
    sign = chance.choice((1.0, -1.0))
    apart = chance.choice((0.05, 0.2, 1.0))
    common = random_wave(chance)
    own = [random_wave(chance) for _ in AXIS_NAMES]

    def course(time):
        offsets = []
        speeds = []
        for wave in own:
            scaled = (sign * apart, wave), (2.0 * sign, common)
            offsets.append(sum(scale * one.offset(time) for scale, one in scaled))
            speeds.append(sum(scale * one.speed(time) for scale, one in scaled))
        return offsets, speeds

    return course


@pytest.mark.parametrize('seed', NEAREST)
def test_no_carriage_touches_a_neighbour_that_fails(seed):
    chance = random.Random(seed)
    lag = chance.choice(LAGS)
    failure = chance.choice(FAILURES)
    middle = chance.uniform(-0.1, 0.1)
    left = middle - chance.uniform(0.021, 0.1)
    right = middle + chance.uniform(0.021, 0.1)
    axes = axes_at((left, right, middle))
    settings = replace(SETTINGS, drive_lag=lag, hold_cycles=1)
    drives = [SimulatedDrive(axis, SimulationSettings(lag=lag)) for axis in axes]
    # m/s, keeps the following error below 15 mm
    speed = min(0.5, 0.0149 / max(lag, 1e-3))
    rig = Rig(settings, axes, drives, limits=MotionLimits(speed=speed))
    rig.request('configure', 'home', 'activate')
    rig.course = swing(chance)
    rig.run(chance.uniform(0.05, 0.9))
    assert rig.state is ControllerState.ACTIVE, rig.all_causes
    failure(rig.drives[chance.randrange(3)])
    end = rig.clock.now + WATCHED
    while rig.clock.now < end:
        rig.cycles(1)
        q1, q2, q3 = rig.carriages
        assert min(q3 - q1, q2 - q3) > TOUCHING


@pytest.mark.parametrize(
    ('lie', 'message'),
    [
        (lambda drive: setattr(drive, 'is_deaf', True), 'q2 (node 2) is 0.0'),
        (half_following, 'q2 (node 2) is 0.0'),
        (ignore_targets, 'bit 12 is 0'),
    ],
)
def test_drive_that_follows_half_stops_all(lie, message):
    rig = Rig()
    in_motion(rig)
    lie(rig.drives[1])
    rig.until(lambda: rig.state is not ControllerState.ACTIVE)
    assert message in rig.all_causes
    off = abs(rig.follower.motion.position[1] - rig.carriages[1])
    unnoticed = rig.settings.drive_lag + 4 * rig.settings.period  # s
    assert off <= 0.015 + MotionLimits().speed * unnoticed
