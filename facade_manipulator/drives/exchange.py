"""
Cyclic exchange on an open bus: receive, supervise, step and command, once per SYNC.

The cycle with its times as shares of the period:

    0.0    SYNC: the drives latch the targets of the previous cycle and send their positions
    ...    the answers arrive; the last one makes the step due
    0.7    the step is due without further answers
    0.8    the commands of the step must be sent: targets that come later are withdrawn
    1.0    the next SYNC

The kernel sends this SYNC at its own time, or else the loop sends it after the commands
(`cycle`). The owner of the exchange waits until the step is due, reads its own messages, and then
does the step. Frames are routed by COB-ID; a frame that is too short or unknown is ignored.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
import math

from facade_manipulator.canopen import cob_ids, emcy, nmt
from facade_manipulator.canopen.bus import BusCongestedError, CanBus, Frame
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.pdo import Pdo
from facade_manipulator.canopen.sdo import is_write
from facade_manipulator.drives.axis import Axis
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.cycle import CycleClock
from facade_manipulator.drives.group import Group
from facade_manipulator.drives.group_state import GroupState
from facade_manipulator.drives.snapshot import Cause, Remedy
from facade_manipulator.drives.targets import TargetSupervisor
from facade_manipulator.errors import BusError

LONGEST_WAIT = 0.02  # s: a stop acts within this time, also while all drives are silent
# of the heartbeat time-out: after a longer pause of this loop frames may have been dropped
EXCUSING_PAUSE = 0.5
LONGEST_UNSENT = 0.2  # s, without a frame sent: the bus is lost
# least length of the data, because a drive may pad its frames to 8 bytes; receiver
Route = tuple[int, Callable[[Frame], Cause | None]]
_OPERATIONAL = nmt.heartbeat('OPERATIONAL')
_IGNORED: Route = (0, lambda _: None)
_FOREIGN_SYNC = cob_ids.frames_of_masters(())[cob_ids.SYNC]
_MASTER_HEARTBEAT = cob_ids.HEARTBEAT + cob_ids.MASTER_NODE_ID


class CyclicExchange:
    """
    Cyclic exchange with three drives, on a bus that it owns.

    Its owner calls `wait` and `step` in turn. Sending and receiving raise a BusError if the bus is
    lost.
    """

    def __init__(
        self,
        bus: CanBus,
        group: Group,
        targets: TargetSupervisor,
        settings: ControllerSettings,
        clock: Clock,
    ) -> None:
        axes = group.axes
        self._now = clock.monotonic
        self._stamp = clock.time
        self.bus = bus
        self.group = group
        self.has_started = False  #: whether the cycle has started
        self.clock = CycleClock(settings.period, len(axes), bus.has_kernel_sync)
        #: whether heartbeats are sent; a bus that was just opened is only listened to
        self.transmits = False
        #: whether a SYNC before the start is accepted, because a drive may send it
        self.accepts_sync = True
        self.has_received_sync = False  #: whether SYNC was received before the start
        self._settings = settings
        self._targets = targets
        self._next_heartbeat = 0.0
        self._waits_for_sync = False
        self._is_due = False  # whether the step of the cycle is due
        self._next_sync: Frame | None = None  # received before the step was done
        self._has_local_sync = False  # whether our SYNC returns marked as sent here
        #: `read_until`: time [s] until which all received frames have been read
        self._pumped = self.read_until = self._now()
        #: since when the send queue is full [s]; network management commands that wait for room
        self._full_since = math.inf
        self._waiting_commands: deque[tuple[str, int]] = deque()
        self._routes: dict[
            int, Route
        ] = {  # this master does not receive its own frames
            cob_id: (0, partial(self._on_other_master, *frame))
            for cob_id, frame in cob_ids.frames_of_masters(
                axis.settings.node_id for axis in axes
            ).items()
        }
        self._routes[cob_ids.SYNC] = 0, self._on_early_sync
        for axis in axes:
            node = axis.settings.node_id
            self._routes |= {
                cob_ids.EMERGENCY + node: (
                    emcy.ERROR_CODE_LENGTH,
                    axis.receive_emergency,
                ),
                cob_ids.HEARTBEAT + node: (1, partial(self._on_heartbeat, axis)),
                cob_ids.SDO_REQUEST + node: (1, partial(self._on_sdo_request, node)),
                cob_ids.SDO_RESPONSE + node: (0, axis.sdo.receive),
            }
            for tpdo in axis.profile.tpdos:
                self._routes[tpdo.cob_id(node)] = (
                    tpdo.codec.size,
                    partial(self._on_tpdo, axis, tpdo),
                )
        bus.listen_to(tuple(self._routes))

    # --- receiving

    def _dispatch(self, frame: Frame) -> None:
        least_length, receive = self._routes.get(frame.cob_id, _IGNORED)
        if len(frame.data) >= least_length:
            cause = receive(frame)
            if cause is not None:
                self.stop_for(cause)

    def _on_other_master(
        self, name: str, commands_drives: bool, _: Frame
    ) -> Cause | None:
        """Return the cause of a stop; raise a BusError until this master starts its cycle."""
        if not self.has_started:
            raise self._other_master(name)
        return (
            None
            if not commands_drives
            else Cause(
                f'another master is on the bus, {name} was received',
                Remedy.OTHER_MASTER,
            )
        )

    def _on_sdo_request(self, node: int, frame: Frame) -> Cause | None:
        """Return the cause of a stop for a write of another master; reading changes nothing."""
        writes = is_write(frame.data)
        name = f'an SDO {"write" if writes else "request"} to node {node}'
        return self._on_other_master(name, writes, frame)

    def _on_heartbeat(self, axis: Axis, frame: Frame) -> Cause | None:
        """
        Receive a heartbeat; return the cause of a stop, if any.

        No quick stop reaches a drive that another master has made pre-operational. The NMT
        command *stop* does, and a drive with power then stops as configured by 6007h.
        """
        cause = axis.receive_heartbeat(frame)
        if self.has_started and axis.node.is_unreachable:
            self.command('STOPPED', axis)
        return cause

    @staticmethod
    def _other_master(name: str) -> BusError:
        return BusError(
            f'another master uses this bus: {name} was received; end that master (a second '
            'driver, a configuration tool), or open another bus'
        )

    def _on_early_sync(self, frame: Frame) -> None:
        """Record a SYNC before the start; raise a BusError unless a drive may have sent it."""
        self.has_received_sync = True
        if not self.accepts_sync:
            self._on_other_master(*_FOREIGN_SYNC, frame)

    def forget_sync(self) -> None:
        """Forget the SYNC that was received from drives, before configure ended it."""
        self.has_received_sync = False

    def begin_transmission(self) -> None:
        """Send heartbeats from now on; a bus that was just opened is only listened to."""
        self.transmits = True

    def expect_sync(self, is_expected: bool) -> None:
        """
        Expect SYNC of a drive until the start, or no SYNC.

        Raises a BusError if SYNC was received that no drive has sent.
        """
        self.accepts_sync = is_expected
        if self.has_received_sync and not is_expected:
            raise self._other_master(_FOREIGN_SYNC[0])

    def _on_sync(self, frame: Frame) -> Cause | None:
        """
        Begin a cycle with the SYNC of the kernel; return the cause of a stop for a foreign one.

        Our SYNC has no data. Where SocketCAN marks it as sent on this computer, a SYNC without
        this mark is foreign. Elsewhere the clock counts the SYNCs that are too many.
        """
        self._has_local_sync = self._has_local_sync or frame.is_local
        is_unmarked = self._has_local_sync and not frame.is_local
        if frame.data or is_unmarked:
            return self._on_other_master(*_FOREIGN_SYNC, frame)
        if self.clock.is_unexpected(frame.time):
            return None
        if self.clock.is_open:  # a late loop: the step comes before the next cycle
            self._next_sync = frame
            self._is_due = True
        else:
            self.clock.receive(frame.time, frame.stamp)
        return None

    def _on_tpdo(self, axis: Axis, tpdo: Pdo, frame: Frame) -> Cause | None:
        before = axis.answers.newest
        cause = axis.receive_tpdo(tpdo, frame.data, frame.time, self.clock.sync_time)
        if axis.answers.newest != before:
            self.clock.answer(self._pumped)
        return cause

    def stop_for(self, cause: Cause) -> None:
        """Stop the drives, with a command at once instead of at the end of the cycle."""
        before = self.group.state
        if self.has_started:
            self.group.stop(cause, self._now())
            if before is not GroupState.STOPPED:
                self._send_commands()

    # --- the cycle

    def start(self, now: float) -> None:
        """Start SYNC at a time [s], and send the commands of the group in each cycle."""
        self.has_started = True
        self._pumped = now
        self.clock.start(now)
        self.group.start(now)
        for axis in self.group.axes:
            axis.begin_supervision(now)
        self._routes[cob_ids.SYNC] = (
            0,
            partial(self._on_other_master, *_FOREIGN_SYNC),
        )
        if self.bus.has_kernel_sync:
            self._routes[cob_ids.SYNC] = 0, self._on_sync
            self.bus.start_sync(self._settings.period)

    def wait(self) -> None:
        """
        Handle frames until the step is due, for `LONGEST_WAIT` at most.

        Before the start of the cycle the method returns after each frame, because a request may
        wait for it.
        """
        end = self._now() + LONGEST_WAIT
        self._pump(end)
        while self.has_started and not self._is_due and self._now() < end:
            self._pump(end)

    def step(self) -> bool:
        """Do the step of the cycle if it is due; return whether it was."""
        if not self._is_due:
            return False
        self._is_due = False
        self._step(self._now())
        if self._next_sync is not None:
            self.clock.receive(self._next_sync.time, self._next_sync.stamp)
            self._next_sync = None
        return True

    def _pump(self, end: float) -> None:
        """Wait for the next frame or deadline, until a time [s] at most; handle the frame."""
        heartbeat = self._next_heartbeat if self.transmits else math.inf
        deadline = min(end, heartbeat, self.clock.next_event)
        frame = self.bus.receive(deadline - self._now())
        now = self._now()
        pause = now - self._pumped
        self._pumped = now
        if pause > EXCUSING_PAUSE * self._settings.heartbeat_timeout:
            for axis in self.group.axes:
                axis.silence.excuse(now)
        if pause > self._settings.heartbeat_timeout:
            # the drives are not silent, because their frames still wait
            self.stop_for(
                Cause(
                    f'the control loop was paused for {1e3 * pause:.0f} ms, '
                    f'above the limit {1e3 * self._settings.heartbeat_timeout:.0f} ms '
                    '(controller.heartbeat_timeout)',
                    Remedy.COMPUTER,
                )
            )
        self._send_waiting_commands()
        self.read_until = now if frame is None else frame.time
        if frame is not None:
            self._dispatch(frame)
        if now >= heartbeat:
            self._next_heartbeat = now + self._settings.heartbeat_period
            self._send(_MASTER_HEARTBEAT, _OPERATIONAL)
        if self.has_started:
            self._advance(frame, now)

    def _advance(self, frame: Frame | None, now: float) -> None:
        """Note the due step or send the due SYNC, unless more frames must be read first."""
        clock = self.clock
        if self._waits_for_sync:
            self._send_commands()
        if now < clock.next_event or (
            frame is not None and clock.may_wait(now, frame.time)
        ):
            return
        if clock.is_open:
            self._is_due = True
        else:
            clock.begin(self._now(), self._stamp())
            self._send(cob_ids.SYNC)

    def _step(self, now: float) -> None:
        in_time = self.clock.finish(now)
        group = self.group
        targets = self._targets
        may_rest = not group.is_ramping or targets.mechanism.source.at_rest
        for axis in group.axes:
            axis.end_cycle(self.clock.sync_time, may_rest)
        targets.supervise(now)
        for cause in self._failures():
            group.stop(cause, now)
        taken_out = set(group.not_responding)
        group.step(now)
        if in_time or not group.follows:
            targets.command(self.clock, now)
            has_ended_in_time = self.clock.finish_commands(self._now())
            if has_ended_in_time or not group.follows:
                self._send_commands()
            else:
                targets.withdraw()
        for axis in group.axes:
            if axis.name in group.not_responding - taken_out:  # despite a quick stop
                self.command('STOPPED', axis)

    def _failures(self) -> list[Cause]:
        """Return the causes of a stop by silent drives, and by the cycle unless stopped."""
        group = self.group
        is_running = group.state is not GroupState.STOPPED
        causes = []
        if is_running or group.is_stopped:  # not while a cleanup cuts the power
            causes += self._silences()
        if is_running:
            causes += self.clock.causes(
                self._settings.max_missed_cycles, group.state.has_power
            )
        return causes

    def _silences(self) -> list[Cause]:
        """
        Return the causes of newly silent drives: one cause for the bus if all are silent.

        The age of frames counts until the last frame that was read: others may wait to be read.
        A silent drive may have restarted unnoticed, also while the drives are stopped.
        """
        silent: list[Axis] = []
        causes: list[Cause] = []
        for axis in self.group.axes:
            cause = axis.silence.new_cause(self.read_until)
            if cause is not None:
                silent.append(axis)
                causes.append(cause)
        if len(silent) == len(self.group.axes):
            message = f'no drive answers any longer: {causes[0].message}'
            if self.bus.is_virtual:  # simulated drives pause with this process
                is_new = not self.group.is_stopped
                return [Cause(message, Remedy.COMPUTER)] if is_new else []
            causes = [Cause(message, Remedy.BUS, configure_again=True)]
        for axis in silent:
            axis.lose()
        return causes

    # --- sending

    def _send_commands(self) -> None:
        """
        Send one command to each drive, all three between the same two SYNCs.

        Just before the kernel's SYNC the commands wait for it. Otherwise one drive might latch its
        command a period before the others. Only commands of drives that follow no targets wait:
        late targets are withdrawn.
        """
        self._waits_for_sync = not self.clock.has_time(self._now())
        if self._waits_for_sync:
            return
        frames: list[tuple[int, bytes]] = []
        for axis in self.group.axes:
            frames += axis.frames()
        for cob_id, data in frames:  # all are encoded before any is sent
            self._send(cob_id, data)

    def _send(self, cob_id: int, data: bytes = b'') -> None:
        """Send a frame; a queue that is full now may have room in the next cycle."""
        self._try_to_send(partial(self.bus.send, cob_id, data))

    def command(self, name: str, axis: Axis) -> None:
        """Send a network management command to a drive, as soon as the send queue has room."""
        axis.expect(name)
        self._waiting_commands.append((name, axis.settings.node_id))
        self._send_waiting_commands()

    def _send_waiting_commands(self) -> None:
        while self._waiting_commands:
            send = partial(self.bus.command, *self._waiting_commands[0])
            if not self._try_to_send(send):
                return
            self._waiting_commands.popleft()

    def _try_to_send(self, send: Callable[[], None]) -> bool:
        """Return whether a frame was sent; raise if the queue is full for `LONGEST_UNSENT`."""
        try:
            send()
        except BusCongestedError:
            self._full_since = min(self._full_since, self._pumped)
            if self._pumped - self._full_since >= LONGEST_UNSENT:
                raise
            return False
        self._full_since = math.inf
        return True
