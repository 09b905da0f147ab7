"""
Random frames and random setpoints against a drive controller that is idle, at rest or moving.

``python test/fuzz.py --frames 1000000`` is the long run of `test_fuzz`.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import contextmanager, suppress
from dataclasses import replace
import logging
import math
import os
from pathlib import Path
import random
import sys
import time
from typing import NamedTuple

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE / 'helpers')]

import can  # noqa: E402
from command_watch import CommandWatch  # noqa: E402
from fault_rig import AMPLITUDE, PATIENT, SITUATIONS, StreamRig  # noqa: E402
from fault_table import repair  # noqa: E402

from facade_manipulator.drives.controller.snapshot import ControllerState  # noqa: E402
from facade_manipulator.errors import ManipulatorError  # noqa: E402
from facade_manipulator.motion.setpoints import Setpoint  # noqa: E402

BUS_OFF = 0x40
NEAR = (0x000, 0x080, 0x180, 0x200, 0x280, 0x380, 0x580, 0x600, 0x700)
# what the drives and their master say to each other, with its length
OURS = {0x000: 2, 0x080: 0, 0x77F: 1, **{
    base + node: length for node in (1, 2, 3) for base, length in (
        (0x080, 8), (0x180, 7), (0x200, 7), (0x280, 8), (0x380, 8), (0x580, 8), (0x600, 8),
        (0x700, 1))}}
COMMANDING = {cob_id for cob_id in OURS if cob_id & 0x780 in (0x000, 0x200, 0x600)} | {
    0x080, 0x77F}
BURST = 0.005  # s
SWITCH_INTERVAL = 0.0005  # s: what are computers of their own shares one interpreter here
PRIORITY = 10  # as controller.realtime_priority, which other programs' load makes necessary


class Verdict(NamedTuple):
    """
    What a run of the fuzzer has found.

    Attributes
    ----------
    frames : int
        How many were sent.
    rate : float
        Frames per second.
    enabling : int
        Commands with power that were checked.
    complaints : tuple of str
        Commands out of limits, and errors that nobody foresaw.
    missed : dict
        How many cycles were incomplete, late and skipped.
    cycles : int
    stops : int
        How often a forged frame has stopped the drives.

    """

    frames: int
    rate: float
    enabling: int
    complaints: tuple[str, ...]
    missed: dict[str, int]
    cycles: int
    stops: int


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


class Complaints(logging.Handler):
    """What is logged as an error."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.messages: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep the message, and the error's if there is one."""
        error = record.exc_info[1] if record.exc_info else ''
        self.messages.append(f'{record.getMessage()} {error!r}')


@contextmanager
def complaints():
    """Collect what `facade_manipulator` logs as an error meanwhile."""
    handler, logger = Complaints(), logging.getLogger('facade_manipulator')
    logger.addHandler(handler)
    try:
        yield handler.messages
    finally:
        logger.removeHandler(handler)


class Fuzzer:
    """
    One run: a rig in a situation, frames at a rate, and a watch over what the master commands.

    Parameters
    ----------
    rig : StreamRig
    situation : str
        To which it returns after each stop.
    make : callable
        Makes a frame.
    rate : float
        Frames per second, if the computer can.
    seed : int

    """

    def __init__(
        self, rig: StreamRig, situation: str, make: Callable[[random.Random], can.Message],
        rate: float, seed: int = 0,
    ) -> None:
        self._rig, self._situation, self._make, self._rate = rig, situation, make, rate
        self._rng = random.Random(seed)
        self._watch = CommandWatch(rig.axes, PATIENT.period)
        self._stops = self._cycles = 0
        self._missed = dict.fromkeys(('incomplete', 'late', 'skipped'), 0)

    def run(self, frames: int) -> Verdict:
        """Send frames until there were as many; bring the drives back whenever they stop."""
        sent, seconds = 0, 0.0
        with complaints() as said:
            while sent < frames:
                self._enter()
                begin = time.monotonic()
                sent += self._until_stopped(frames - sent)
                seconds += time.monotonic() - begin
                self._leave()
            alive = self._rig.controller._thread.is_alive()
        return Verdict(
            sent, sent / seconds, self._watch.enabling,
            (*self._watch.complaints, *said, *(() if alive else ('the control thread died',))),
            self._missed, self._cycles, self._stops)

    def _enter(self) -> None:
        if self._situation == 'unconfigured':
            return
        self._bring_up()
        self._before = self._rig.controller.snapshot().cycle

    def _bring_up(self, tries: int = 5) -> None:
        """Reach the situation; a computer that is too busy may need a second try."""
        try:
            self._rig.get_ready()
            SITUATIONS[self._situation](self._rig)
        except (AssertionError, ManipulatorError) as error:
            print(f'not {self._situation} at once: {error}', file=sys.stderr)
            if tries == 0:
                raise
            self._rig.fall_silent()
            self._start_again()
            self._bring_up(tries - 1)

    def _until_stopped(self, frames: int) -> int:
        """Send until stopped, and then some more: a stop must stand what made it."""
        sent = 0
        least = min(frames, 500)
        while sent < least or (sent < frames and not self._is_stopped()):
            begin = time.monotonic()
            for _ in range(min(frames - sent, round(self._rate * BURST))):
                self._rig.listener.send(self._make(self._rng))
                sent += 1
            self._watch.take(self._rig.frames())
            time.sleep(max(0.0, begin + BURST - time.monotonic()))
        return sent

    def _is_stopped(self) -> bool:
        return self._rig.state in (ControllerState.STOPPED, ControllerState.BUS_LOST)

    def _leave(self) -> None:
        rig = self._rig
        if self._situation == 'unconfigured':
            return
        rig.cycles(2)
        self._count(rig.controller.snapshot().cycle)
        self._stops += self._is_stopped()
        rig.fall_silent()
        self._watch.take(rig.frames())
        if self._is_stopped():
            self._start_again()
        elif self._situation != 'inactive':
            rig.do('deactivate')

    def _count(self, cycle) -> None:
        before = self._before
        self._cycles += cycle.cycles - before.cycles
        for name in self._missed:
            self._missed[name] += getattr(cycle, name) - getattr(before, name)

    def _start_again(self) -> None:
        """
        Park the carriages, for forged commands may have moved them, and configure again.

        Whatever else was forged into the drives is gone with their reset.

        """
        rig = self._rig
        rig.until(ControllerState.STOPPED, ControllerState.INACTIVE)
        rig.do('cleanup')
        repair(rig)
        with rig.simulator.access() as drives:
            for drive, axis in zip(drives, rig.axes, strict=True):
                drive.motor.place(axis.home_position)
        self._watch.take(rig.frames())
        rig.configure()


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


# --- the long run

def take_precedence() -> None:
    """Share the interpreter finely, and the processor with nobody, where that is permitted."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    with suppress(PermissionError):  # for all threads that begin after this
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))


def share(verdict: Verdict) -> float:
    """Return the share of the cycles that were missed."""
    return sum(verdict.missed.values()) / max(1, verdict.cycles)


MOST_MISSED = 0.001
LONG_RUN = replace(PATIENT, own_garbage_collection=True)  # as the driver does
RUNS = (  # situation, frames, share of all, rate, whether cycles count: nothing stops the drives
    ('unconfigured', anything, 0.1, 4000.0, False),
    ('inactive', strange, 0.2, 3000.0, True),
    ('moving', strange, 0.5, 3000.0, True),
    ('inactive', anything, 0.1, 4000.0, False),
    ('moving', anything, 0.1, 4000.0, False),
)


def run_all(frames: int, channel: str = 'fuzz') -> bool:
    """Run every kind of fuzz and print what it found; return whether nothing was wrong."""
    good = True
    take_precedence()
    for number, (situation, make, part, rate, counts) in enumerate(RUNS):
        rig = StreamRig(f'{channel} {number}', LONG_RUN)
        try:
            verdict = Fuzzer(rig, situation, make, rate, number).run(round(part * frames))
        finally:
            rig.close()
        fine = not verdict.complaints and (not counts or share(verdict) < MOST_MISSED)
        good = good and fine
        print(f'{situation}, {make.__name__} frames: {verdict.frames} at {verdict.rate:.0f}/s, '
              f'{verdict.enabling} commands with power, {verdict.stops} stops, '
              f'missed of {verdict.cycles} cycles: {verdict.missed} '
              f'({100.0 * share(verdict):.3f} %)'
              f'{"" if fine else " FAILED " + "; ".join(verdict.complaints)}', flush=True)
    return good


def main() -> int:
    """Fuzz; exit status 1 if something was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--frames', type=int, default=1_000_000)
    return 0 if run_all(parser.parse_args().frames) else 1


if __name__ == '__main__':
    sys.exit(main())
