"""Whichever of three drives fails, on a plant of the tests' own: no neighbour touches it."""

from __future__ import annotations

import math
import random

from own_plant import Plant
import pytest

from facade_manipulator.drives.cia402.controller_state import ControllerState
from facade_manipulator.motion.limits import MotionLimits

LAGS = (0.0, 0.005, 0.015, 0.025, 0.035)
FAILURES = ('dead', 'seized', 'brakes')
AHEAD, WATCHED = 0.03, 80  # s; cycles


def swing(chance, start):
    """Let the carriages swing, each on its own and all together."""
    apart = chance.choice((0.05, 0.2, 1.0))
    common, *own = [
        (chance.uniform(0.0, 0.2), chance.uniform(0.5, 5.0), chance.uniform(0.0, 6.3))
        for _ in range(4)]

    def at(time):
        position, velocity = list(start), [0.0] * 3
        for number, one in enumerate(own):
            for scale, (size, rate, state) in ((apart, one), (2.0, common)):
                angle = rate * time + state
                position[number] += scale * size * (math.sin(angle) - math.sin(state))
                velocity[number] += scale * size * rate * math.cos(angle)
        return position, velocity
    return at


def sweep(chance, start, directions=(1, 1, 1)):
    """Send all carriages along the rail, and back or to a halt."""
    fast, turn, back = chance.uniform(0.1, 0.5), chance.uniform(0.05, 0.8), chance.choice((-1, 0))
    fast *= chance.choice((-1, 1))

    def at(time):
        way = min(time, turn) + back * max(0.0, time - turn)
        speed = fast * (1 if time < turn else back)
        return ([q + way * fast * one for q, one in zip(start, directions, strict=True)],
                [speed * one for one in directions])
    return at


def meet(chance, start):
    """Send each carriage where it may meet a neighbour."""
    return sweep(chance, start, [chance.choice((-1, 0, 1)) for _ in start])


def least_left(seed):
    """Return the least distance of neighbours in a motion in which a drive fails [m]."""
    chance = random.Random(seed)
    lag, failure = chance.choice(LAGS), chance.choice(FAILURES)
    middle = chance.uniform(-0.1, 0.1)
    plant = Plant(
        (middle - chance.uniform(0.021, 0.1), middle + chance.uniform(0.021, 0.1), middle), lag,
        limits=MotionLimits(speed=min(0.5, 0.0149 / max(lag, 1e-3))))
    at = chance.choice((swing, sweep, meet))(chance, plant.follower.motion.position)
    victim, fails_at, begin = chance.randrange(3), chance.randrange(5, 90), plant.now
    for cycle in range(fails_at + WATCHED):
        if cycle == fails_at:
            assert plant.group.state is ControllerState.ACTIVE, plant.group.causes
            plant.left = math.inf
            plant.drives[victim].fail(failure)
        plant.stream(*at(plant.now - begin + AHEAD))
        plant.turn()
        if plant.group.state is ControllerState.STOPPED:
            break
    return plant.left, lag, failure, seed


@pytest.mark.parametrize('part', range(3))
def test_no_carriage_touches_a_neighbour_that_fails(part):
    assert min(map(least_left, range(12 * part, 12 * part + 12)))[0] > 0.0


@pytest.mark.long
def test_in_many_more_motions_no_carriage_touches_a_neighbour_that_fails():
    worst = min(map(least_left, range(36, 236)))
    print(f'least distance {1e3 * worst[0]:.2f} mm: lag, failure, seed {worst[1:]}')
    assert worst[0] > 0.0
