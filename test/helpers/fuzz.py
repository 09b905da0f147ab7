"""
Random frames and random setpoints against a drive controller that is idle, at rest or moving.

All of it in simulated time: whoever calls has entered one.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import contextmanager
import logging
import math
import random
import time
from typing import NamedTuple

import can
from command_watch import CommandWatch
from fault_rig import AMPLITUDE, PATIENT, SITUATIONS, StreamRig

from facade_manipulator.drives.controller.snapshot import ControllerState
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.motion.setpoints import Setpoint

BUS_OFF = 0x40
NEAR = (0x000, 0x080, 0x180, 0x200, 0x280, 0x380, 0x580, 0x600, 0x700)
# what the drives and their master say to each other, with its length
OURS = {0x000: 2, 0x080: 0, 0x77F: 1, **{
    base + node: length for node in (1, 2, 3) for base, length in (
        (0x080, 8), (0x180, 7), (0x200, 7), (0x280, 8), (0x380, 8), (0x580, 8), (0x600, 8),
        (0x700, 1))}}
COMMANDING = {cob_id for cob_id in OURS if cob_id & 0x780 in (0x000, 0x200, 0x600)} | {
    0x080, 0x77F}
RATE, BURST = 4000.0, 0.005  # frames/s, s
LEAST = 500  # frames in a row: a stop must stand what made it


class Verdict(NamedTuple):
    """What a run of the fuzzer has found."""

    enabling: int  #: commands with power that were checked
    complaints: tuple[str, ...]  #: commands out of limits, and errors that nobody foresaw
    stops: int  #: how often a forged frame has stopped the drives


def anything(rng: random.Random) -> can.Message:
    """Make a frame of any identifier, length and kind; one in four is near our drives' own."""
    kind = rng.random()
    if kind > 0.95:
        return can.Message(
            arbitration_id=rng.randrange(1 << 29) & ~BUS_OFF, is_error_frame=True,
            data=rng.randbytes(8))
    if kind > 0.8:
        return can.Message(
            arbitration_id=rng.randrange(1 << 29), is_extended_id=True,
            is_remote_frame=kind > 0.9, data=b'' if kind > 0.9 else _data(rng))
    near = rng.random() < 0.25
    cob_id = rng.choice(NEAR) + rng.randrange(4) if near else rng.randrange(0x800)
    remote = kind > 0.7
    return can.Message(arbitration_id=cob_id, is_extended_id=False, is_remote_frame=remote,
                       data=b'' if remote else _data(rng))


def strange(rng: random.Random) -> can.Message:
    """Make a frame that is nobody's business here, however much it looks like one."""
    while True:
        frame = anything(rng)
        if frame.is_extended_id or frame.is_remote_frame or frame.is_error_frame:
            return frame
        cob_id = frame.arbitration_id
        if cob_id not in COMMANDING and OURS.get(cob_id) != len(frame.data):
            return frame


def _data(rng: random.Random) -> bytes:
    return rng.randbytes(rng.randrange(9))


@contextmanager
def complaints():
    """Collect what `facade_manipulator` logs as an error meanwhile, and the errors themselves."""
    messages: list[str] = []
    handler, logger = logging.Handler(logging.ERROR), logging.getLogger('facade_manipulator')
    handler.emit = lambda record: messages.append(
        f'{record.getMessage()} {(record.exc_info or (None, None))[1]!r}')
    logger.addHandler(handler)
    try:
        yield messages
    finally:
        logger.removeHandler(handler)


def fuzz(
    situation: str, make: Callable[[random.Random], can.Message], frames: int,
) -> Verdict:
    """Send frames to drives in a situation, to other ones whenever a frame has stopped them."""
    rng, sent, stops = random.Random(0), 0, 0
    enabling, found = 0, []
    with complaints() as said:
        while sent < frames:
            rig = StreamRig(f'fuzz {make.__name__} {situation} {sent}')
            watch = CommandWatch(rig.axes, PATIENT.period)
            try:
                sent += _send_until_stopped(
                    rig, watch, situation, lambda: make(rng), frames - sent)
                stops += _is_stopped(rig)
                if not rig.controller._thread.is_alive():
                    found.append('the control thread died')
            finally:
                rig.close()
            enabling += watch.enabling
            found += watch.complaints
    return Verdict(enabling, (*found, *said), stops)


def _send_until_stopped(
    rig: StreamRig, watch: CommandWatch, situation: str, make: Callable[[], can.Message],
    most: int,
) -> int:
    if situation != 'unconfigured':
        rig.get_ready()
        SITUATIONS[situation](rig)
    sent = 0
    while sent < min(LEAST, most) or (sent < most and not _is_stopped(rig)):
        for _ in range(min(most - sent, round(RATE * BURST))):
            rig.listener.send(make())
            sent += 1
        watch.take(rig.frames())
        time.sleep(BURST)
    if situation != 'unconfigured':
        rig.cycles(2)
    watch.take(rig.frames())
    return sent


def _is_stopped(rig: StreamRig) -> bool:
    return rig.state in (ControllerState.STOPPED, ControllerState.BUS_LOST)


# --- setpoints

def bad_setpoints(rng: random.Random, good: Setpoint) -> list[Setpoint]:
    """Return setpoints that must not be followed, made of one that was taken just now."""
    def shifted(metres: float) -> tuple[float, ...]:
        return tuple(q + metres for q in good.position)

    number, nothing = rng.randrange(3), rng.choice((math.nan, math.inf, -math.inf))

    def with_nothing(values):
        return tuple(nothing if n == number else value for n, value in enumerate(values))

    off = shifted(-2.5 * AMPLITUDE)  # it would be seen at once; no stream begins so far away
    later = good.time + 0.001
    return [
        Setpoint(good.time - 2.0, off, good.velocity),
        Setpoint(good.time + 5.0, off, good.velocity),
        Setpoint(good.time, off, good.velocity),
        Setpoint(good.time - rng.uniform(0.0, 0.1), off, good.velocity),
        Setpoint(later, with_nothing(good.position), good.velocity),
        Setpoint(later, good.position, with_nothing(good.velocity)),
        Setpoint(nothing, off, good.velocity),
        Setpoint(later, shifted(rng.choice((-1.0, 1.0)) * rng.uniform(0.06, 0.4)), (0.0,) * 3),
        Setpoint(later, (0.0, 0.0, 0.0), good.velocity),
    ]


def fuzz_setpoints(rig: StreamRig, seconds: float, seed: int = 0) -> tuple[int, CommandWatch]:
    """
    Stream at 100 Hz and throw nine bad setpoints among each good one: 1 kHz together.

    Returns how many bad ones were sent, and the watch over the commands; raises AssertionError
    if one of them is not rejected.
    """
    rng, bad = random.Random(seed), 0
    watch = CommandWatch(rig.axes, PATIENT.period)
    rig.stream(lambda setpoint: None)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        now = time.time()
        good = rig.setpoint()
        try:
            rig.follower.add(good, now)
        except ManipulatorError:  # after a pause of this computer it may be out of reach
            time.sleep(PATIENT.period)
            continue
        for setpoint in bad_setpoints(rng, good):
            time.sleep(0.001)
            try:
                rig.follower.add(setpoint, now)
            except ManipulatorError:
                bad += 1
            else:
                raise AssertionError(f'{setpoint} was taken')
        watch.take(rig.frames())
    return bad, watch


RUNS = (  # situation, frames
    ('unconfigured', anything), ('inactive', strange), ('moving', strange),
    ('inactive', anything), ('moving', anything))
