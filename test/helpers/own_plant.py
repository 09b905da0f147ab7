"""
Three drives of the tests' own on one rail, and the machine's own cycle around them, in pure time.

Each drive interpolates, lags, brakes and fails on its own, as written down here and nowhere in the
package; what commands and supervises them are the package's follower, checks, monitors and group.
"""

from __future__ import annotations

from contextlib import suppress
import math

from facade_manipulator.drives.canopen import pdo
from facade_manipulator.drives.canopen.bus import Frame
from facade_manipulator.drives.cia402.cause import Cause
from facade_manipulator.drives.cia402.controller_state import ControllerState
from facade_manipulator.drives.cia402.group import Group
from facade_manipulator.drives.cia402.settings import AXIS_NAMES, DEFAULT_AXES
from facade_manipulator.drives.controller.cycle import SyncProducer
from facade_manipulator.drives.controller.monitor import AxisMonitor
from facade_manipulator.drives.controller.settings import ControllerSettings
from facade_manipulator.drives.controller.targets import TargetSupervisor
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.loop.control_loop import checked_follower, LoopSetup
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.setpoints import Setpoint

SUBSTEPS = 10  # of a cycle
STATUSWORDS = {0x00: 0x0240, 0x06: 0x0221, 0x07: 0x0223, 0x0F: 0x0227, 0x02: 0x0207}
FOLLOWING_ERROR, POSITION_LIMIT = 0x8611, 0x8A82
LIES = ('half', 'deaf', 'ignores')  # which say that they have no following error
LEAD = 0.03  # s


class PlantDrive:
    """
    A carriage and its drive; `fails` says how, '' for not at all.

    ``'dead'`` stands and is silent, ``'seized'`` stands and answers, ``'half'`` does half of what
    it is commanded, ``'deaf'`` receives no RPDO any more, ``'ignores'`` stands and says so in bit
    12, ``'brakes'`` stops by itself and reports it by an emergency message; a following error
    reports whoever is not lying.
    """

    def __init__(self, axis, position: float, lag: float) -> None:
        self.axis, self.lag = axis, lag
        self.position = self._from = self.target = self._latched = self.demand = position
        self.velocity = self._demanded = 0.0
        self.word, self.fails, self._outside = 0, '', 0
        self.inbox: list[tuple[int, bytes]] = []
        self.emergencies: list[bytes] = []

    def fail(self, how: str) -> None:
        self.fails, self._start = how, self.demand
        if how == 'brakes':
            self._report(POSITION_LIMIT)

    def _report(self, code: int) -> None:
        self.emergencies.append(code.to_bytes(2, 'little') + bytes(6))

    @property
    def statusword(self) -> int:
        follows = self.word == 0x0F and self.fails not in ('ignores', 'brakes')
        return STATUSWORDS[0x02 if self.fails == 'brakes' else self.word] | 0x1000 * follows

    def sync(self, node: int) -> list[tuple[int, bytes]]:
        """Latch what was received; return the answers to the SYNC."""
        answers = [(pdo.TPDO1.cob_id(node), pdo.TPDO1.codec.pack(
            self.statusword, 8, self.axis.to_counts(self.position)))]
        answers.append((pdo.TPDO2.cob_id(node), pdo.TPDO2.codec.pack(
            round(self.velocity / self.axis.si_per_unit.velocity),
            0 if self.fails in LIES else self.axis.to_counts(self.demand - self.position))))
        if self.fails != 'deaf':
            for _, data in self.inbox:
                word, _, counts = pdo.RPDO1.codec.unpack(data)
                self.word, self._latched = word, self.axis.to_metres(counts)
        self.inbox.clear()
        self._from, self.target = self.target, self._latched
        emergencies = [(pdo.emergency_cob_id(node), data) for data in self.emergencies]
        self.emergencies.clear()
        return [] if self.fails == 'dead' else answers + emergencies

    def live(self, period: float) -> None:
        """Move for a cycle."""
        step = period / SUBSTEPS
        for number in range(1, SUBSTEPS + 1):
            self._follow(number / SUBSTEPS, step)
        self._watch()

    def _follow(self, share: float, step: float) -> None:
        before = self.position
        if self.fails in ('dead', 'seized', 'ignores'):
            self.velocity = 0.0
            self.demand = self._from + share * (self.target - self._from)
            return
        if self.word == 0x0F and self.fails != 'brakes':
            demand = self._from + share * (self.target - self._from)
            if self.fails == 'half':
                demand = self._start + 0.5 * (demand - self._start)
            self._demanded, self.demand = (demand - self.demand) / step, demand
        else:  # a ramp from what is demanded
            left = max(0.0, abs(self._demanded) - self.axis.stop_deceleration * step)
            self._demanded = math.copysign(left, self._demanded)
            self.demand += self._demanded * step
        decay = 1.0 if self.lag == 0.0 else 1.0 - math.exp(-step / self.lag)
        self.position += (self.demand - self.position) * decay
        self.velocity = (self.position - before) / step

    def _watch(self) -> None:
        """Trip for a following error that lasts for a cycle, unless the drive lies."""
        outside = abs(self.target - self.position) > self.axis.following_error_window
        self._outside = self._outside + 1 if outside and self.word == 0x0F else 0
        if self._outside == 2 and self.fails in ('', 'seized'):
            self._report(FOLLOWING_ERROR)


class Plant:
    """The machine's cycle around three such drives; `left` is the least distance there was [m]."""

    def __init__(
        self, positions, lag: float = 0.0, settings: ControllerSettings | None = None,
        axes=DEFAULT_AXES, geometry: Geometry | None = None, limits: MotionLimits | None = None,
        known_lag: float | None = None,
    ) -> None:
        self.settings = settings or ControllerSettings(
            drive_lag=lag if known_lag is None else known_lag, hold_cycles=1)
        self.geometry = geometry or Geometry()
        self.period, self.cycle = self.settings.period, 0
        self.drives = [PlantDrive(axis, position, lag)
                       for axis, position in zip(axes, positions, strict=True)]
        self.monitors = tuple(
            AxisMonitor(name, axis, self.settings)
            for name, axis in zip(AXIS_NAMES, axes, strict=True))
        self.follower, mechanism = checked_follower(
            LoopSetup(self.geometry, self.settings, axes, limits=limits or MotionLimits()))
        self.targets = TargetSupervisor(axes, self.settings, mechanism)
        self.group = Group(AXIS_NAMES, self.settings)
        self.clock = SyncProducer(self.period, 3)
        for monitor in self.monitors:
            monitor.begin_supervision(0.0)
            monitor.encoder.end_homing(True)
        self.left = math.inf
        while self.group.state is not ControllerState.ACTIVE:
            self.turn()
            if self.group.state is ControllerState.INACTIVE and self.group.is_settled:
                self.group.enable(self.now)
            assert self.cycle < 100, self.group.causes

    @property
    def now(self) -> float:
        return self.cycle * self.period

    @property
    def positions(self) -> list[float]:
        return [drive.position for drive in self.drives]

    @property
    def at_rest(self) -> bool:
        return max(abs(drive.velocity) for drive in self.drives) < 1e-3

    def stream(self, position, velocity=(0.0, 0.0, 0.0)) -> None:
        """Send a setpoint; what is rejected moves nothing."""
        with suppress(ManipulatorError):
            self.follower.add(
                Setpoint(self.now + LEAD, tuple(position), tuple(velocity)), self.now)

    def turn(self) -> None:
        """Live through a SYNC, the answers to it, one step of the control loop, and a period."""
        self.cycle += 1
        now = self.now
        self.clock.begin(now, now)
        for monitor, drive in zip(self.monitors, self.drives, strict=True):
            for cob_id, data in drive.sync(monitor.axis.node_id):
                self._receive(monitor, cob_id, data)
            if drive.fails != 'dead':
                monitor.receive_heartbeat(Frame(0x700, b'\x05', now, now))
        self._step()
        for drive in self.drives:
            drive.live(self.period)
        q1, q2, q3 = self.positions
        self.left = min(self.left, q3 - q1, q2 - q3)

    def _receive(self, monitor: AxisMonitor, cob_id: int, data: bytes) -> None:
        tpdo = {one.cob_id(monitor.axis.node_id): one for one in monitor.tpdos}.get(cob_id)
        cause: Cause | None = (
            monitor.receive_emergency(Frame(cob_id, data, self.now, self.now)) if tpdo is None
            else monitor.receive_tpdo(tpdo, data, self.now, self.now))
        if cause is not None:
            self.group.stop(cause, self.now)

    def _step(self) -> None:
        now, group = self.now, self.group
        feedback = tuple(monitor.end_cycle(now) for monitor in self.monitors)
        self.clock.finish(now)
        self.targets.supervise(group, self.monitors, now)
        for monitor in self.monitors:
            if (cause := monitor.silence(now)) is not None:
                group.stop(cause, now)
        commands = self.targets.command(
            group, group.step(feedback, now),
            tuple(monitor.encoder.counts or 0 for monitor in self.monitors), self.clock, now)
        for monitor, drive, command, counts in zip(
                self.monitors, self.drives, commands, self.targets.counts, strict=True):
            drive.inbox += monitor.encode(command, counts)
