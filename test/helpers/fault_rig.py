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
from frames import decode_rpdo1
from support import hear_much, wait_until

from facade_manipulator.drives.canopen import pdo
from facade_manipulator.drives.cia402.settings import DEFAULT_AXES
from facade_manipulator.drives.cia402.states import Controlword, State
from facade_manipulator.drives.controller.controller import DriveController
from facade_manipulator.drives.controller.session import BusAccess
from facade_manipulator.drives.controller.settings import ControllerSettings
from facade_manipulator.drives.controller.snapshot import ControllerState
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.loop.control_loop import assemble, LoopSetup
from facade_manipulator.motion.setpoints import Setpoint

# for tests: what a busy computer does is no fault
PATIENT = replace(SETTINGS, max_missed_cycles=5, hold_cycles=1, reopen_after=0.2)
# for figures: the project's own bounds
EXACT = replace(PATIENT, max_missed_cycles=3, heartbeat_timeout=0.15)
SLOW_HOMING = tuple(
    replace(axis, homing_method=17, homing_speed=0.03) for axis in DEFAULT_AXES)
AMPLITUDE, FREQUENCY, AHEAD = 0.03, 0.6, 0.06

Spoil = Callable[[Setpoint], Setpoint | None]


def _perfect(setpoint: Setpoint) -> Setpoint:
    return setpoint


class StreamRig(Rig):
    """A rig whose targets come from a stream of setpoints, as in the driver."""

    def __init__(self, channel: str, settings=PATIENT, **details) -> None:
        super().__init__(channel, settings=settings, **details)
        self.settings = settings
        self.received: list[can.Message] = []
        self.repairs: list[Callable[[], object]] = []
        self.spoil: Spoil = _perfect
        if self.interface == 'socketcan':
            self._receive_what_matters()
        self._streaming = threading.Event()
        self._closed = threading.Event()
        self._streamer = threading.Thread(target=self._stream, daemon=True)
        self._streamer.start()

    def _make_controller(self, settings: ControllerSettings) -> DriveController:
        self.follower, controller = assemble(
            LoopSetup(Geometry(), settings, self.axes), BusAccess(self.open_bus))
        return controller

    def close(self) -> None:
        self.repair()
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
        while not self._closed.wait(self.settings.period):
            setpoint = self.spoil(self.setpoint()) if self._streaming.is_set() else None
            if setpoint is not None:
                with suppress(ManipulatorError):  # what it rejects is what some rows are about
                    self.follower.add(setpoint, time.time())

    # --- the bus

    def _receive_what_matters(self) -> None:
        """Let the kernel keep what is asked for until it is read."""
        wanted = [pdo.SYNC_COB_ID]
        for axis in self.axes:
            wanted += pdo.RPDO1.cob_id(axis.node_id), pdo.emergency_cob_id(axis.node_id)
        self.listener.set_filters([
            {'can_id': cob_id, 'can_mask': 0x7FF, 'extended': False} for cob_id in wanted])
        hear_much(self.listener.socket)

    def listen(self) -> list[can.Message]:
        """Return what the listener has received since it was last asked, and keep all."""
        frames = self.frames()
        self.received += frames
        return frames

    def overhear(self) -> None:
        """From now on hear what the drives say even where the bus carries nothing."""
        send = self.simulator._send

        def say(frames, *time_of_them) -> None:
            now = time.time()
            self.received += [
                can.Message(now, cob_id, False, data=data) for cob_id, data in frames]
            send(frames, *time_of_them)

        self.simulator._send = say
        self.repairs.append(lambda: self.simulator.__dict__.pop('_send'))

    def repair(self) -> None:
        """Undo what was done to the interface, and to what is received from it."""
        while self.repairs:
            self.repairs.pop()()

    # --- situations

    def get_ready(self) -> None:
        """Be inactive, with resets left: how many a minute takes is not the question here."""
        if self.state is ControllerState.UNCONFIGURED:
            self.configure()
        self.controller._session.group._resets.clear()

    def configure(self) -> None:
        self.do('configure')
        self.assert_never_enabled()
        if not self.is_homing_rig:
            self.do('home')
            self.listen()

    def clear(self) -> str:
        """Clear the faults; that gives no power."""
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
    homing = rig.homing = rig.controller.request('home')
    wait_until(lambda: homing.done() or rig.drive_states == [State.OPERATION_ENABLED] * 3
               and min(rig.speeds()) > 0.0, 'homing')
    assert not homing.done(), homing.result()


def _at_rest(rig: StreamRig) -> None:
    rig.do('activate')


def _moving(rig: StreamRig) -> None:
    rig.do('activate')
    rig.stream()
    wait_until(lambda: abs(rig.controller.snapshot().axes[0].velocity) > 0.05
               or rig.state is not ControllerState.ACTIVE, 'motion')
    assert rig.state is ControllerState.ACTIVE, rig.all_causes


SITUATIONS = {'inactive': _inactive, 'homing': _homing, 'at rest': _at_rest, 'moving': _moving}


class OneRig:
    """The rig in use, on any bus: shared by situations with the same axes, or given up."""

    def __init__(
        self, settings=PATIENT, interface: str = 'virtual', channel: str = 'faults',
    ) -> None:
        self._settings = settings
        self._bus = {'interface': interface, 'channel': channel}
        self._rig: StreamRig | None = None

    def get(self, situation: str) -> StreamRig:
        """Return a rig for a situation."""
        axes = SLOW_HOMING if situation == 'homing' else DEFAULT_AXES
        if self._rig is None or axes is not self._rig.axes:
            self.close()
            self._rig = StreamRig(settings=self._settings, axes=axes, **self._bus)
        return self._rig

    def close(self) -> None:
        """Give the rig up."""
        rig, self._rig = self._rig, None
        if rig is not None:
            rig.close()


def enables(frame: can.Message) -> bool:
    """Tell whether a frame commands a drive to be enabled."""
    if frame.arbitration_id & 0x780 != pdo.RPDO1.cob_id(0):
        return False
    word = decode_rpdo1(bytes(frame.data)).controlword
    return word & 0x0F == Controlword.ENABLE_OPERATION
