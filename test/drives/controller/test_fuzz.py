"""Random frames and setpoints do not stop or move the drives wrongly."""

from __future__ import annotations

import random

import can
from command_watch import COMMANDS, CommandWatch
from fault_rig import AMPLITUDE, SITUATIONS, StreamRig
from fuzz import anything, fuzz, fuzz_setpoints, OURS, RUNS, strange
import pytest

from facade_manipulator.drives.cia402.settings import DEFAULT_AXES
from facade_manipulator.drives.controller.snapshot import ControllerState

FRAMES = 3000
ROUNDING = 5e-6  # m
PERIOD = 0.01


@pytest.fixture
def rig(simulated_time, request):
    made = StreamRig(request.node.name)
    yield made
    made.close()


@pytest.mark.parametrize(
    ('situation', 'make'), RUNS,
    ids=[f'{run[0]}-{run[1].__name__}' for run in RUNS])
def test_random_frames_raise_nothing_and_command_nothing_out_of_limits(
        simulated_time, situation, make):
    verdict = fuzz(situation, make, FRAMES)
    assert verdict.complaints == ()
    assert bool(verdict.stops) is (make is anything and situation != 'unconfigured')
    assert verdict.enabling > 0 or situation in ('unconfigured', 'inactive')


def test_bad_setpoints_at_a_kilohertz_are_rejected_and_none_reaches_a_drive(rig):
    rig.get_ready()
    SITUATIONS['at rest'](rig)
    start = rig.controller.snapshot().joints().positions
    bad, watch = fuzz_setpoints(rig, 3.0)
    assert rig.state is ControllerState.ACTIVE
    assert bad > 500
    assert watch.complaints == []
    assert watch.enabling > 300
    for q, least, greatest in zip(start, watch.least, watch.greatest, strict=True):
        assert q - ROUNDING <= least
        assert greatest <= q + 2.0 * AMPLITUDE + ROUNDING
        assert greatest > q + AMPLITUDE


def test_a_strange_frame_is_none_that_drives_and_master_exchange():
    rng = random.Random(0)
    for _ in range(5000):
        frame = strange(rng)
        plain = not (frame.is_extended_id or frame.is_remote_frame or frame.is_error_frame)
        assert not plain or OURS.get(frame.arbitration_id) != len(frame.data)


def command(node: int, metres: float, controlword: int = 0x0F) -> can.Message:
    counts = DEFAULT_AXES[node - 1].to_counts(metres)
    return can.Message(arbitration_id=0x200 + node, is_extended_id=False,
                       data=COMMANDS.pack(controlword, 8, counts))


@pytest.mark.parametrize('frames, message', [
    ([command(2, 0.51)], '202h: a target of 0.51'),
    ([command(3, 0.0), command(3, 0.02)], '203h: a step of 0.02'),
])
def test_the_watch_complains_of_a_command_out_of_limits(frames, message):
    watch = CommandWatch(DEFAULT_AXES, PERIOD)
    watch.take(frames)
    assert message in watch.complaints[0]
