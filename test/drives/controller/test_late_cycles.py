"""The control loop comes late with power on: the drives hold meanwhile, and nothing stops."""

from __future__ import annotations

import itertools
import math
import time

import pytest
from virtual_world import World

from facade_manipulator.drives.controller.snapshot import ControllerState
from facade_manipulator.motion.setpoints import Setpoint

pytestmark = pytest.mark.simulated

FAST, AMPLITUDE, LEAD = 0.4, 0.12, 0.04  # m/s, m, s
RATE = FAST / AMPLITUDE
STARVED = 0.02  # s


@pytest.fixture
def world():
    made = World()
    for request in ('configure', 'home', 'activate'):
        made.finish(made.controller.request(request), 60.0)
    yield made
    made.close()


class Stream:
    """Setpoints that swing all carriages to and fro, once a cycle."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.base = world.follower.motion.position
        self.begin = self.due = world.time.now

    def send(self) -> None:
        world = self.world
        if world.time.now < self.due:
            return
        self.due = world.time.now + world.settings.period
        phase = RATE * (world.time.now - self.begin + LEAD)
        step, speed = 0.5 * AMPLITUDE * (1 - math.cos(phase)), 0.5 * FAST * math.sin(phase)
        world.stream(Setpoint(
            world.time.time() + LEAD, tuple(q + 2 * step for q in self.base), (2 * speed,) * 3))


@pytest.mark.parametrize('pause', [0.03, 0.07, 0.09])
def test_a_loop_that_is_late_at_full_speed_leaves_no_carriage_behind(world, pause):
    stream = Stream(world)
    for phase in (0.5, 2.75, 5.5):
        world.run(stream.begin + phase * math.pi / RATE - world.time.now, stream.send)
        world.pass_time(pause)
        world.run(1.0, stream.send)
        snapshot = world.controller.snapshot()
        assert snapshot.state is ControllerState.ACTIVE, snapshot.causes
        assert not snapshot.unhomed
        assert world.follower.activity.value == 'following'


@pytest.mark.parametrize('every', [2, 7, 31])
def test_each_request_is_answered_though_the_loop_is_late_again_and_again(every):
    world, pauses = World(), itertools.cycle([0.04, *[0.0] * (every - 1)])

    def be_late() -> None:
        world._pause = next(pauses)

    try:
        for request, state in (
                ('configure', 'inactive'), ('self_test', 'inactive'), ('home', 'inactive'),
                ('activate', 'active'), ('halt', 'halted'), ('clear_faults', 'active'),
                ('deactivate', 'inactive'), ('cleanup', 'unconfigured')):
            world.finish(world.controller.request(request), 60.0, be_late)
            assert world.controller.snapshot().state.value == state
    finally:
        world.close()


@pytest.mark.parametrize('before', ['receive', 'send'])
def test_a_simulated_drive_that_is_starved_says_where_it_was_at_the_sync(rig, before):
    rig.source.speed = 0.75 * FAST
    rig.do('configure', 'home', 'activate')
    rig.cycles(50)
    rig.frames()
    frames, pauses = rig.simulator._bus, itertools.cycle([STARVED, *[0.0] * 50])
    call = getattr(frames, before)
    setattr(frames, before, lambda *what: (time.sleep(next(pauses)), call(*what))[1])
    rig.cycles(40)
    snapshot = rig.controller.snapshot()
    assert snapshot.state is ControllerState.ACTIVE, snapshot.causes
    stamps = {0x080: [], 0x181: []}
    for frame in rig.frames():
        stamps.get(frame.arbitration_id, []).append(frame.timestamp)
    assert stamps[0x181] == pytest.approx(stamps[0x080][:len(stamps[0x181])], abs=1e-4)
