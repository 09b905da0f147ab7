"""
Cyclic exchange on an open bus: receive, supervise, step and command once per SYNC.

One cycle, in the order of the methods (`cycle` shows its times, and the two senders of SYNC):

    wait      SYNC: the kernel's is received, or the loop sends its own (`_send_sync`)
              answers: each is passed to its axis; the last one, or time, makes the step due
    (between) the control loop reads the messages of the node
    step      supervise: drives, SYNC, targets; a failure stops the group
              step the states of the group
              choose the targets, and send the commands; late targets are withdrawn

Frames are routed by COB-ID; a frame that is too short or unknown is ignored. A stop sends its
commands at once, or after a SYNC that is near (`stop_for`); a further cause acts in the next step.
"""

from __future__ import annotations

from functools import partial

from facade_manipulator.canopen import cob_ids, emcy
from facade_manipulator.canopen.bus import CanBus, Frame
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.pdo import Pdo
from facade_manipulator.drives.axis import Axis
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.cycle import CycleClock
from facade_manipulator.drives.group import Group
from facade_manipulator.drives.group_state import GroupState
from facade_manipulator.drives.other_masters import OtherMasters, Receiver
from facade_manipulator.drives.snapshot import Cause, Remedy
from facade_manipulator.drives.targets import TargetSupervisor
from facade_manipulator.drives.transmitter import Transmitter
from facade_manipulator.errors import compared

LONGEST_WAIT = 0.02  # s: a stop acts within this time, also while all drives are silent
# minimum length of the data, because a drive may pad its frames to 8 bytes; receiver
Route = tuple[int, Receiver]


class CyclicExchange:
    """
    Cyclic exchange with three drives on the bus that this object owns.

    Its owner calls `wait` and `step` in turn. Sending and receiving raise a BusError if the bus is
    lost.
    """

    # of the heartbeat time-out: after a longer pause of this loop frames may have been dropped
    EXCUSING_PAUSE = 0.5
    _IGNORED: Route = (0, lambda _: None)

    def __init__(
        self,
        bus: CanBus,
        group: Group,
        targets: TargetSupervisor,
        settings: ControllerSettings,
        clock: Clock,
    ) -> None:
        self.bus = bus
        self.group = group
        self.clock = CycleClock(settings.period, len(group.axes), bus.has_kernel_sync)
        self.transmitter = Transmitter(bus, clock, settings.heartbeat_period)
        self.masters = OtherMasters()
        self.has_started = False  #: whether the cycle has started
        self._targets = targets
        self._settings = settings
        self._time = clock
        self._is_due = False  # whether the step of the cycle is due
        self._next_sync: Frame | None = None  # received before the step was done
        self._waits_for_sync = False  # whether commands wait for the kernel's SYNC
        self._pumped = clock.monotonic()  # time of the last look for frames [s]
        #: time [s] until which all received frames have been read
        self.read_until = self._pumped
        self._routes = self._all_routes()
        bus.listen_to(tuple(self._routes))

    def _all_routes(self) -> dict[int, Route]:
        """Return the functions that receive frames of drives and other masters, by COB-ID."""
        node_ids = [axis.settings.node_id for axis in self.group.axes]
        routes: dict[int, Route] = {}
        for cob_id, receive in self.masters.receivers(node_ids).items():
            routes[cob_id] = (0, receive)
        for axis in self.group.axes:
            node = axis.settings.node_id
            length = emcy.ERROR_CODE_LENGTH
            routes[cob_ids.EMERGENCY + node] = (length, axis.receive_emergency)
            routes[cob_ids.HEARTBEAT + node] = (1, partial(self._on_heartbeat, axis))
            routes[cob_ids.SDO_RESPONSE + node] = (0, axis.sdo.receive)
            for tpdo in axis.profile.tpdos:
                receive = partial(self._on_tpdo, axis, tpdo)
                routes[tpdo.cob_id(node)] = (tpdo.codec.size, receive)
        return routes

    def start(self, now: float) -> None:
        """Start SYNC at a time [s]; from then on, send the group's commands in each cycle."""
        self.has_started = True
        self._pumped = now
        self.masters.start()
        self.clock.start(now)
        self.group.start(now)
        for axis in self.group.axes:
            axis.begin_supervision(now)
        if self.bus.has_kernel_sync:
            self._routes[cob_ids.SYNC] = (0, self._on_sync)
            self.bus.start_sync(self._settings.period)

    # --- wait: SYNC and answers

    def wait(self) -> None:
        """
        Handle frames until the step is due, for at most `LONGEST_WAIT`.

        Before the start of the cycle the method returns after each frame, because a request may
        wait for this frame.
        """
        end = self._time.monotonic() + LONGEST_WAIT
        self._pump(end)
        while self.has_started and not self._is_due and self._time.monotonic() < end:
            self._pump(end)

    def _pump(self, end: float) -> None:
        """Wait for the next frame or deadline, at most until a time [s]; handle the frame."""
        deadline = min(end, self.transmitter.next_heartbeat, self.clock.next_event)
        frame = self.bus.receive(deadline - self._time.monotonic())
        now = self._time.monotonic()
        pause = now - self._pumped
        self._pumped = now
        self._judge_pause(pause, now)
        self.transmitter.send_waiting_commands()
        if frame is None:
            self.read_until = now
        else:
            self.read_until = frame.time
            self._dispatch(frame)
        self.transmitter.send_heartbeat(now)
        if self.has_started:
            self._advance(frame, now)

    def _judge_pause(self, pause: float, now: float) -> None:
        """Stop the drives if this loop pauses for too long [s]."""
        limit = self._settings.heartbeat_timeout
        if pause > self.EXCUSING_PAUSE * limit:
            # the drives are not silent, because their frames still wait
            for axis in self.group.axes:
                axis.silence.excuse(now)
        if pause > limit:
            pause_text, limit_text = compared(1e3 * pause, 1e3 * limit, '.0f')
            message = (
                f'the control loop was paused for {pause_text} ms, '
                f'above the limit {limit_text} ms (controller.heartbeat_timeout)'
            )
            self.stop_for(Cause(message, Remedy.COMPUTER))

    def _dispatch(self, frame: Frame) -> None:
        """Pass a frame to its receiver; stop the drives if the receiver returns a cause."""
        least_length, receive = self._routes.get(frame.cob_id, self._IGNORED)
        if len(frame.data) >= least_length:
            cause = receive(frame)
            if cause is not None:
                self.stop_for(cause)

    def _on_sync(self, frame: Frame) -> Cause | None:
        """
        Begin a cycle with the SYNC of the kernel.

        Return the cause of a stop by the SYNC of another master, if any.
        """
        self.masters.note_own_sync(frame)
        if self.masters.is_foreign_sync(frame):
            return self.masters.receive_foreign_sync(frame)
        if not self.clock.accept_sync(frame.time):
            return None  # too early: counted as a possible SYNC of another master
        if self.clock.is_open:  # a late loop: the step comes before the next cycle
            self._next_sync = frame
            self._is_due = True
        else:
            self.clock.receive(frame.time, frame.stamp)
        return None

    def _on_tpdo(self, axis: Axis, tpdo: Pdo, frame: Frame) -> Cause | None:
        """Receive process data; return the cause of a stop, if any."""
        before = axis.answers.newest
        cause = axis.receive_tpdo(tpdo, frame.data, frame.time, self.clock.sync_time)
        if axis.answers.newest != before:
            self.clock.answer(self._pumped)
        return cause

    def _on_heartbeat(self, axis: Axis, frame: Frame) -> Cause | None:
        """
        Receive a heartbeat; return the cause of a stop, if any.

        No quick stop reaches a drive that another master has made pre-operational. The NMT command
        *stop* reaches this drive. A drive with power then stops as configured by 6007h.
        """
        cause = axis.receive_heartbeat(frame)
        if self.has_started and axis.node.is_unreachable:
            self.command('STOPPED', axis)
        return cause

    def _advance(self, frame: Frame | None, now: float) -> None:
        """Mark the step as due or send the due SYNC, unless more frames must be read first."""
        clock = self.clock
        if self._waits_for_sync:
            self._send_commands(now)
        if now < clock.next_event:
            return
        if frame is not None and clock.let_wait(now, frame.time):
            return
        if clock.is_open:
            self._is_due = True
        else:
            self._send_sync()

    def _send_sync(self) -> None:
        self.clock.begin(self._time.monotonic(), self._time.time())
        self.transmitter.send(cob_ids.SYNC)

    # --- step: supervision, states, targets and commands

    def step(self) -> bool:
        """Execute the cycle step if it is due; return whether it was due."""
        if not self._is_due:
            return False
        self._is_due = False
        self._step(self._time.monotonic())
        if self._next_sync is not None:
            self.clock.receive(self._next_sync.time, self._next_sync.stamp)
            self._next_sync = None
        return True

    def _step(self, now: float) -> None:
        """Supervise the drives, advance the group, and send a cycle's commands at a time [s]."""
        may_send = self.clock.finish(now)
        self._supervise(now)

        taken_out = set(self.group.not_responding)
        self.group.step(now)

        if may_send or not self.group.follows:
            self._command_targets(now)
        for axis in self.group.axes:
            if axis.name in self.group.not_responding - taken_out:
                self.command('STOPPED', axis)  # the axis moves or keeps its power

    def _supervise(self, now: float) -> None:
        """Supervise drives, targets and cycle; stop the group after a failure."""
        group = self.group
        may_rest = not group.is_ramping or self._targets.source.at_rest
        for axis in group.axes:
            axis.end_cycle(self.clock.sync_time, may_rest)
        self._targets.supervise(now)
        for cause in self._failures():
            group.stop(cause, now)

    def _failures(self) -> list[Cause]:
        """Return the causes of a stop: silent drives and, unless stopped, cycle failures."""
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
        Return one cause for each newly silent drive, or a cause for the bus if all are silent.

        Ages are measured up to the last frame that was read, because further frames may be unread.
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

    def _command_targets(self, now: float) -> None:
        """Choose targets and send the commands; withdraw targets that are too late."""
        self._targets.command(self.clock, now)
        chosen = self._time.monotonic()
        may_send = self.clock.finish_commands(chosen)
        if may_send or not self.group.follows:
            self._send_commands(chosen)
        else:
            self._targets.withdraw()

    def _send_commands(self, now: float) -> None:
        """
        Send all commands between the same two SYNCs; skip a drive that has restarted.

        Shortly before the time of the kernel's SYNC the commands wait, and `_advance` tries again.
        Otherwise one drive might latch its command a period before the other drives. Only commands
        of drives that follow no targets wait: late targets are withdrawn.
        """
        self._waits_for_sync = not self.clock.has_time(now)
        if self._waits_for_sync:
            return
        frames: list[tuple[int, bytes]] = []
        for axis in self.group.axes:
            frames += axis.frames()
        for cob_id, data in frames:  # all are encoded before any is sent
            self.transmitter.send(cob_id, data)

    # --- at any time

    def stop_for(self, cause: Cause) -> None:
        """
        Stop the drives with a command that is sent at once, not at the end of the cycle.

        The method has no effect before the start of the cycle.
        """
        before = self.group.state
        if self.has_started:
            self.group.stop(cause, self._time.monotonic())
            if before is not GroupState.STOPPED:
                self._send_commands(self._time.monotonic())

    def command(self, name: str, axis: Axis) -> None:
        """Send a network management command to a drive when the send queue has room."""
        axis.expect(name)
        self.transmitter.command(name, axis.settings.node_id)
