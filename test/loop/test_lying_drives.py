"""Drives that say they do what they do not: found by their positions, how far off is measured."""

from __future__ import annotations

import math

from own_plant import Plant
import pytest

from facade_manipulator.drives.cia402.controller_state import ControllerState

VICTIM, AHEAD = 1, 0.03
LAG = 0.015  # s, as shipped


def moving(speed, lag=LAG, known=LAG):
    """Return a plant whose carriages all move, and the stream that moves them."""
    plant = Plant((-0.3, -0.1, -0.2), lag, known_lag=known)
    begin = plant.now

    def turn():
        way = speed * (plant.now - begin + AHEAD)
        plant.stream([q + way for q in (-0.3, -0.1, -0.2)], [speed] * 3)
        plant.turn()

    for _ in range(40):
        turn()
    assert plant.group.state is ControllerState.ACTIVE, plant.group.causes
    return plant, turn


def stop(plant, turn, how):
    """Let a drive fail; return how far it is off [m] when all are commanded to stop."""
    plant.drives[VICTIM].fail(how)
    for _ in range(300):
        turn()
        if plant.group.state is not ControllerState.ACTIVE:
            return abs(plant.follower.motion.position[VICTIM] - plant.drives[VICTIM].position)
    return math.inf


@pytest.mark.parametrize('speed', [0.1, 0.3, 0.5])
@pytest.mark.parametrize(('how', 'message', 'most'), [
    ('deaf', 'q2 (node 2) is 0.0', 0.015),
    ('half', 'q2 (node 2) is 0.0', 0.015),
    ('ignores', 'q2 does not follow its targets, bit 12 is 0', 0.0),
])
def test_a_drive_that_does_not_what_it_is_commanded_stops_all(how, message, most, speed):
    plant, turn = moving(speed)
    off = stop(plant, turn, how)
    assert message in plant.group.cause.message
    assert off <= most + speed * (LAG + 4 * plant.period)
