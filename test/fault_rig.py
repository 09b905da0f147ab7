"""A rig whose targets come from a stream of setpoints, and the situations that faults meet."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
import math
import threading
import time

import can
from drive_rig import Rig, SETTINGS
from support import wait_until

from facade_manipulator.control.guard import MechanismGuard
from facade_manipulator.control.limits import MotionLimits
from facade_manipulator.control.setpoints import Setpoint, SetpointFollower, StreamSettings
from facade_manipulator.drives import pdo
from facade_manipulator.drives.cia402 import Controlword, State
from facade_manipulator.drives.settings import DEFAULT_AXES
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Geometry

# for tests: what a busy computer does is no fault
PATIENT = replace(SETTINGS, max_missed_cycles=5, hold_cycles=1, reopen_after=0.2)
# for figures: the project's own bounds, but for the executor, for it is the test that runs in it
EXACT = replace(PATIENT, max_missed_cycles=3, heartbeat_timeout=0.15)
SLOW_HOMING = tuple(
    replace(axis, homing_method=17, homing_speed=0.03) for axis in DEFAULT_AXES)
AMPLITUDE, FREQUENCY, AHEAD = 0.03, 0.6, 0.06
RESETS = 3  # a minute

Spoil = Callable[[Setpoint], Setpoint | None]


def _perfect(setpoint: Setpoint) -> Setpoint:
    return setpoint


class StreamRig(Rig):
    """A rig whose targets come from a stream of setpoints, as in the driver."""

    def __init__(self, channel: str, settings=PATIENT, **details) -> None:
        guard = MechanismGuard(Geometry())
        self.follower = SetpointFollower(
            StreamSettings(), MotionLimits(), settings.period, guard)
        super().__init__(channel, settings=settings, source=self.follower,
                         check_targets=guard, **details)
        self.settings = settings
        self.clears = 0
        self.heard: list[can.Message] = []
        self.spoil: Spoil = _perfect
        self._streaming = threading.Event()
        self._closed = threading.Event()
        self._streamer = threading.Thread(target=self._stream, daemon=True)
        self._streamer.start()

    def close(self) -> None:
        self._closed.set()
        self._streamer.join()
        super().close()

    # --- the stream

    def stream(self, spoil: Spoil = _perfect) -> None:
        """Let all carriages go to and fro together, from where they are to about home."""
        motion = self.follower.motion
        self._base = motion.position if motion else tuple(a.home_position for a in DEFAULT_AXES)
        self._sign = -1.0 if self._base[0] > DEFAULT_AXES[0].home_position else 1.0
        self._begin = time.time() + AHEAD
        self.spoil = spoil
        self._streaming.set()

    def fall_silent(self) -> None:
        self._streaming.clear()

    def setpoint(self) -> Setpoint:
        now = time.time() + AHEAD
        angle = 2.0 * math.pi * FREQUENCY * (now - self._begin)
        shift = self._sign * AMPLITUDE * (1.0 - math.cos(angle))
        speed = self._sign * AMPLITUDE * 2.0 * math.pi * FREQUENCY * math.sin(angle)
        return Setpoint(now, tuple(q + shift for q in self._base), (speed,) * 3)

    def _stream(self) -> None:
        while not self._closed.wait(PATIENT.period):
            setpoint = self.spoil(self.setpoint()) if self._streaming.is_set() else None
            if setpoint is not None:
                with suppress(ManipulatorError):  # what it refuses is what some rows are about
                    self.follower.add(setpoint, time.time())

    # --- the bus

    def listen(self) -> list[can.Message]:
        """Return what the listener has heard since it was last asked, and keep all."""
        frames = self.frames()
        self.heard += frames
        return frames

    # --- situations

    def get_ready(self) -> None:
        """Be inactive, with resets left."""
        if self.state is not ControllerState.UNCONFIGURED and self.clears < RESETS:
            return
        if self.state is not ControllerState.UNCONFIGURED:
            self.do('cleanup')
        self.listen()
        self.configure()

    def configure(self) -> None:
        self.do('configure')
        self.assert_never_enabled()
        self.clears = 0
        if not self.is_homing_rig:
            self.do('home')

    def clear(self) -> str:
        """Clear the faults; that gives no power."""
        self.clears += 1
        answer = self.do('clear_faults')
        self.assert_never_enabled()
        return answer

    def assert_never_enabled(self) -> None:
        """Check that no drive was commanded to be enabled since the listener was last asked."""
        assert not any(map(enables, self.listen()))

    @property
    def is_homing_rig(self) -> bool:
        return self.controller._session.axes[0].homing_method == SLOW_HOMING[0].homing_method

    def speeds(self) -> list[float]:
        with self.simulator.access() as drives:
            return [abs(drive.motor.velocity) for drive in drives]


def _inactive(rig: StreamRig) -> None:
    wait_until(lambda: rig.drive_states == [State.SWITCH_ON_DISABLED] * 3, 'power off')


def _homing(rig: StreamRig) -> None:
    rig.homing = rig.controller.home()
    wait_until(lambda: rig.drive_states == [State.OPERATION_ENABLED] * 3
               and min(rig.speeds()) > 0.0, 'homing')


def _at_rest(rig: StreamRig) -> None:
    rig.do('activate')


def _moving(rig: StreamRig) -> None:
    rig.do('activate')
    rig.stream()
    wait_until(lambda: abs(rig.controller.snapshot().axes[0].velocity) > 0.05
               or rig.state is not ControllerState.ACTIVE, 'motion')
    assert rig.state is ControllerState.ACTIVE, rig.all_causes


SITUATIONS = {'inactive': _inactive, 'homing': _homing, 'at rest': _at_rest, 'moving': _moving}


def enables(frame: can.Message) -> bool:
    """Tell whether a frame commands a drive to be enabled."""
    if frame.arbitration_id & 0x780 != pdo.RPDO1.cob_id(0):
        return False
    word = pdo.decode_rpdo1(bytes(frame.data)).controlword
    return word & 0x0F == Controlword.ENABLE_OPERATION
