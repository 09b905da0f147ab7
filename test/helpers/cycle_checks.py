"""Checks of every cycle of the driver, on the bus and in the simulated drives."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING

from frames import decode_rpdo1
import numpy as np

from facade_manipulator.canopen import pdo
from facade_manipulator.drives.guard import MechanismCheck
from facade_manipulator.drives.snapshot import ControllerSnapshot, ControllerState
from facade_manipulator.drives.states import Controlword, Mode, Power, State
from facade_manipulator.errors import NEXT
from facade_manipulator.kinematics import Geometry
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.motion.limits import MotionLimits

if TYPE_CHECKING:
    from bus_world import Rig

COUNT = 1.0 / 430_000  # m, to which targets are rounded
ROUNDING = (1.0, 2.0, 4.0)  # counts, in the first, second and third difference
LEAST_GAP = 0.012  # m, of the 20 that are commanded, between the carriages as measured
STATUS_AGE = 0.025  # s: the statusword of one SYNC, and the command that acted at it
TOGETHER = 0.2  # s, in which all drives stop when one has left operation
POWERED = {
    State.OPERATION_ENABLED,
    State.QUICK_STOP_ACTIVE,
    State.FAULT_REACTION_ACTIVE,
}
REPORT = 'report this'  # the remedy for a defect of the driver
POWERING = {'activate', 'home'}
FOREIGN_STATES = {ControllerState.UNCONFIGURED, ControllerState.BUS_LOST}


def differences(positions: Sequence[Sequence[float]], period: float) -> list[float]:
    """Return the largest first, second and third differences of positions a period apart."""
    found = []
    changes = np.asarray(positions)
    for power in (1, 2, 3):
        changes = np.diff(changes, axis=0)
        largest = float(abs(changes).max(initial=0.0))
        found.append(largest / period**power)
    return found


def require_limits(
    positions: Sequence[Sequence[float]],
    limits: MotionLimits,
    period: float,
    tolerance: float = 0.001,
) -> None:
    """Require limits, with a relative tolerance, of positions a period [s] apart."""
    bounds = np.array((limits.speed, limits.acceleration, limits.jerk))
    assert (differences(positions, period) <= (1.0 + tolerance) * bounds).all()


class CycleChecks:
    """Checks of closure, stroke, gap, speed, acceleration and jerk of commands, and of power."""

    def __init__(self, rig: Rig) -> None:
        self.is_late = False  #: whether commands may be more than a period apart
        self.limits = MotionLimits()  #: of the commands
        self.check_targets = MechanismCheck(Geometry()).exact
        self.commands = 0  #: sets of three targets that were checked
        self._rig = rig
        self._numbers = {}  # of the axes whose commands come in the default PDO
        for number, axis in enumerate(rig.controller.axes):
            if pdo.RPDO1 in axis.profile.pdos:
                self._numbers[pdo.RPDO1.cob_id(axis.settings.node_id)] = number
        self._read = 0
        self._is_enabled = [False] * 3
        self._targets: dict[int, float] = {}
        self._positions: deque[tuple[float, ...]] = deque(maxlen=4)
        self._confirmed_since: dict[str, float] = {}
        self._apart_since: float | None = None

    def look(self, snapshot: ControllerSnapshot) -> None:
        """Check the events since the previous look; raise an AssertionError."""
        frames = self._rig.heard
        for frame in frames[self._read :]:
            if frame.cob_id in self._numbers:
                self._check_command(
                    self._numbers[frame.cob_id], *decode_rpdo1(frame.data)
                )
        self._read = len(frames)
        self._check_power(snapshot)
        assert not any(cause.remedy == REPORT for cause in snapshot.causes), (
            snapshot.causes
        )
        assert not any(NEXT in cause.message for cause in snapshot.causes), (
            snapshot.causes
        )
        if snapshot.state is ControllerState.ACTIVE:
            q1, q2, q3 = (axis.position for axis in snapshot.axes)
            assert min(q3 - q1, q2 - q3) > LEAST_GAP, (
                f'carriages measured at {q1, q2, q3}'
            )

    def _check_command(
        self, number: int, controlword: int, mode: int, counts: int
    ) -> None:
        is_enabled = controlword & 0x0F == Controlword.ENABLE_OPERATION
        if is_enabled and not self._is_enabled[number]:
            asked = {name for name, job in self._rig.jobs if not job.done()}
            assert asked & POWERING, (
                f'{AXIS_NAMES[number]} is enabled without a request'
            )
        self._is_enabled[number] = is_enabled
        if not is_enabled or mode != Mode.CYCLIC_SYNCHRONOUS_POSITION:
            self._positions.clear()
            self._targets.clear()
            return
        axis = self._rig.controller.axes[number]
        self._targets[number] = axis.settings.to_metres(counts)
        if len(self._targets) == 3:
            self._positions.append(tuple(self._targets[one] for one in range(3)))
            self._targets.clear()
            self._check_motion()

    def _check_motion(self) -> None:
        self.commands += 1
        # otherwise no encoder counts from the carriage's place
        if not self._rig.controller.unhomed:
            self.check_targets(self._positions[-1])
        if self.is_late:
            self._positions.clear()
            return
        bounds = self.limits.speed, self.limits.acceleration, self.limits.jerk
        period = self._rig.settings.period
        for power, value, bound, counts in zip(
            (1, 2, 3),
            differences(self._positions, period),
            bounds,
            ROUNDING,
            strict=True,
        ):
            tolerance = counts * COUNT / period**power
            assert value <= 1.001 * bound + tolerance, (
                f'{power}. difference of the targets {value:.4g}, bound {bound:.4g}'
            )

    def _check_power(self, snapshot: ControllerSnapshot) -> None:
        now = self._rig.clock.now
        if snapshot.state in FOREIGN_STATES:
            self._is_enabled = [False] * 3
        for axis, drive in zip(snapshot.axes, self._rig.drives, strict=False):
            is_lie = axis.power is Power.CONFIRMED_OFF and drive.axis.state in POWERED
            since = self._confirmed_since.setdefault(axis.name, now) if is_lie else now
            if not is_lie:
                self._confirmed_since.pop(axis.name, None)
            assert now - since <= STATUS_AGE, (
                f'{axis.name} has power, though it is confirmed off'
            )
        enabled = [
            drive.axis.state is State.OPERATION_ENABLED for drive in self._rig.drives
        ]
        is_apart = snapshot.state is ControllerState.ACTIVE and not all(enabled)
        self._apart_since = (self._apart_since or now) if is_apart else None
        assert not is_apart or now - self._apart_since <= TOGETHER, (
            f'enabled: {enabled}'
        )
        assert not (snapshot.state is ControllerState.INACTIVE and any(enabled)), (
            'inactive'
        )
