"""Failures of any of three drives in any motion, in which no carriage touches its neighbour."""

from dataclasses import replace
import math
import random

from bus_world import ignore_targets, in_motion, Rig, SETTINGS
from drive_faults import half_following
import pytest

from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.simulation.drives.drive import SimulatedDrive
from facade_manipulator.simulation.drives.motor import SimulationSettings

pytestmark = pytest.mark.long

LAGS = (0.0, 0.005, 0.015, 0.025, 0.035)  # s
WATCHED = 0.8  # s
TOUCHING = Geometry().carriage_length
# seeds of the motions in which neighbours come nearest to each other
NEAREST = (99, 43, 4, 12, 73, 97, 44, 15, 3, 24, 7, 83, 13, 92)


def seize(drive):
    """Hold a carriage at its place against its drive."""
    drive.motor.velocity = 0.0
    drive.motor.follow = lambda *_: None


def die(drive):
    seize(drive)
    drive.is_silent = True


FAILURES = (die, seize, lambda drive: drive.inject_fault(0x8A82))


def swing(chance):
    """Oscillate the carriages, each separately and all together."""
    sign = chance.choice((1.0, -1.0))
    apart = chance.choice((0.05, 0.2, 1.0))
    common, *own = [
        (chance.uniform(0.0, 0.2), chance.uniform(0.5, 5.0), chance.uniform(0.0, 6.3))
        for _ in range(4)
    ]
    waves = [((sign * apart, one), (2.0 * sign, common)) for one in own]

    def course(time):
        return (
            [
                sum(
                    scale * size * (math.sin(rate * time + phase) - math.sin(phase))
                    for scale, (size, rate, phase) in axis
                )
                for axis in waves
            ],
            [
                sum(
                    scale * size * rate * math.cos(rate * time + phase)
                    for scale, (size, rate, phase) in axis
                )
                for axis in waves
            ],
        )

    return course


@pytest.mark.parametrize('seed', NEAREST)
def test_no_carriage_touches_a_neighbour_that_fails(seed):
    chance = random.Random(seed)
    lag = chance.choice(LAGS)
    failure = chance.choice(FAILURES)
    middle = chance.uniform(-0.1, 0.1)
    homes = (
        middle - chance.uniform(0.021, 0.1),
        middle + chance.uniform(0.021, 0.1),
        middle,
    )
    axes = tuple(
        replace(axis, home_position=home)
        for axis, home in zip(DEFAULT_AXES, homes, strict=True)
    )
    rig = Rig(
        replace(SETTINGS, drive_lag=lag, hold_cycles=1),
        axes,
        [SimulatedDrive(axis, SimulationSettings(lag=lag)) for axis in axes],
        limits=MotionLimits(speed=min(0.5, 0.0149 / max(lag, 1e-3))),
    )
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
    assert off <= 0.015 + MotionLimits().speed * (
        rig.settings.drive_lag + 4 * rig.settings.period
    )
