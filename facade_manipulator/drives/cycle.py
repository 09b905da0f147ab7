"""
Clock of the cycle: due times of SYNC, step and commands, and counters of late cycles.

One cycle, with times as shares of the period after its SYNC:

    time   SYNC of the kernel                    SYNC of the loop
    0.0    SYNC: the drives latch the targets of the previous cycle, and answer
    ...    the last answer makes the step due
    0.7    the step is due, also if no drive     the step is due if the first answer came by
           has answered                          0.4; else 0.3 after the first answer
    3.0                                          the step is due without any answer
    ...    step: supervise, choose targets, send the commands
    0.8    later targets are withdrawn, other    later commands delay the next SYNC
           commands wait for the SYNC
    1.0    next SYNC                             next SYNC, at least 0.2 after the commands and
                                                 0.8 after the last SYNC
    1.5    SYNC is overdue: the loop sends one

While received frames are not read yet, 0.7 becomes 0.8 and 1.5 becomes 2.5 with the kernel's SYNC.
With the SYNC of the loop, the step waits while the loop reads frames from before the due time, for
at most a period. A SYNC less than 0.5 periods after the last, such as the kernel's after an
overdue SYNC, begins no cycle.

A cycle is *late* if its step begins, or its commands are chosen, after 0.8. The kernel does not
wait: late targets would reach the drives after the next SYNC, and the drives would latch a double
step one period later. Late targets are therefore withdrawn. The loop waits: it sends late
commands, and then its SYNC. The drives *hold* their last target beyond a period while targets are
withdrawn or a SYNC is late. A period is *skipped* if it passes without a SYNC: the kernel's is
overdue, or the loop is late by a whole period. A cycle is *incomplete* if its step begins without
the answers of all drives.

The kernel sends SYNC if the bus offers its broadcast manager. The period of this SYNC does not
depend on the loop. SYNCs of another master in between are found by counting. An interface does not
return frames to their sender. While the loop sends SYNC, each received SYNC therefore comes from
another master.

Times on the monotonic clock [s] are arguments. The code follows the order of the cycle: the two
senders of SYNC, the counter, and the clock that the exchange uses.
"""

from __future__ import annotations

from collections import deque
import math

from facade_manipulator.drives.snapshot import Cause, CycleStatistics, Remedy

# --- shares of the period

# after SYNC
ANSWERS_DUE = 0.7  # do not wait longer for the answers of the drives
FIRST_ANSWER_DUE = 3.0  # a late computer does not mean a loss of all drives
COMMANDS_DUE = 0.8  # later commands might collide with the next SYNC of the kernel
SYNC_OVERDUE = 1.5  # with all frames read
SYNC_MISSING = 2.5  # with some frames waiting
SYNC_TOO_EARLY = 0.5  # an earlier SYNC begins no cycle
# after other events
OTHERS_DUE = 0.3  # after a late first answer: the other answers may follow
MIN_GAP = 0.2  # from our commands to our next SYNC
# of the time of a SYNC
JITTER = 0.25  # a SYNC that is farther from its expected time sets a new one
CYCLE_ROUNDING = 1e-6

LATE_WINDOW = 500  # cycles over which the share of late cycles is counted


# --- SYNC


class KernelSync:
    """SYNC sent by the kernel's broadcast manager; the loop sends only an overdue SYNC."""

    SURPLUS_WINDOW = 1.0  # s, in which surplus SYNCs are counted

    waits = False

    def __init__(self, period: float) -> None:
        self._period = period
        self._newest = 0.0  # time of the newest SYNC that has begun a cycle [s]
        self._overdue_in_a_row = 0
        self._received: deque[float] = deque()  # SYNCs of the last `SURPLUS_WINDOW` [s]

    def start(self, now: float) -> float:
        """Expect the first SYNC; return the time when it becomes overdue [s]."""
        self._newest = now
        return self.next_sync(now)

    def next_sync(self, now: float) -> float:
        """Return when the next SYNC becomes overdue [s]; it does not wait for commands."""
        return self._newest + SYNC_OVERDUE * self._period

    def accept_sync(self, time: float) -> bool:
        """
        Return whether a SYNC received at a time [s] begins a cycle; count early SYNCs.

        `begin` counts all other SYNCs.
        """
        is_early = time < self._newest + SYNC_TOO_EARLY * self._period
        if is_early:
            self._count(time)
        return not is_early

    def begin(self, time: float, is_received: bool) -> int:
        """
        Begin a cycle at a time [s] with a SYNC of the kernel, or of the loop if overdue.

        Return the number of skipped periods.
        """
        self._newest = time
        if not is_received:
            self._overdue_in_a_row += 1
            return 1
        self._overdue_in_a_row = 0
        self._count(time)
        return 0

    def step_due(self, sync_time: float, first_answer: float | None) -> float:
        """Return the time of the step [s]; it is fixed, because the next SYNC does not wait."""
        return sync_time + ANSWERS_DUE * self._period

    def let_sync_wait(self, now: float) -> bool:
        """Return whether the overdue SYNC may be among the unread frames."""
        return now < self._newest + SYNC_MISSING * self._period

    def let_step_wait(self, now: float, frame_time: float, due: float) -> bool:
        """Return whether a step due at a time [s] leaves time to read more answers."""
        return now < due + (COMMANDS_DUE - ANSWERS_DUE) * self._period

    def has_time(self, now: float) -> bool:
        """Return whether enough time remains before the next SYNC to send all commands."""
        age = (now - self._newest) % self._period
        return age <= COMMANDS_DUE * self._period

    def causes(self, bound: int) -> list[Cause]:
        """Return the causes of a stop: a missing SYNC, or SYNC messages of another master."""
        causes = []
        overdue = self._overdue_in_a_row
        if overdue >= bound:
            causes.append(
                Cause(
                    f'the kernel sent no SYNC for {overdue} periods (limit {bound})',
                    'check the interface and its driver',
                    configure_again=True,
                )
            )
        surplus = self._surplus
        if surplus >= bound:
            causes.append(
                Cause(
                    'another master is on the bus: SYNC (080h) was received between our SYNCs '
                    f'{surplus} times within {self.SURPLUS_WINDOW:g} s (limit {bound})',
                    Remedy.OTHER_MASTER,
                )
            )
        return causes

    @property
    def _surplus(self) -> int:
        """
        Return the number of SYNCs in `SURPLUS_WINDOW` in excess of the kernel's.

        The kernel may send a SYNC late and the next SYNC in time. Such a pair is not a surplus,
        because the time since the first SYNC of the window has room for both.
        """
        if not self._received:
            return 0
        elapsed = self._received[-1] - self._received[0]
        following = len(self._received) - 1
        return max(0, int(following - elapsed / self._period + CYCLE_ROUNDING))

    def _count(self, time: float) -> None:
        """Record a received SYNC, and discard those older than `SURPLUS_WINDOW`."""
        if self._received:  # an earlier time comes from a system clock that was set
            time = max(time, self._received[-1])
        self._received.append(time)
        while self._received[0] <= time - self.SURPLUS_WINDOW:
            self._received.popleft()


class LoopSync:
    """SYNC sent by the loop once a period; it waits for late commands."""

    waits = True

    def __init__(self, period: float) -> None:
        self._next_sync = 0.0
        self._newest: float | None = None  # time of the newest SYNC [s]
        self._period = period
        # since when a due step has waited for earlier frames [s]; infinity: it does not wait
        self._waits_since = math.inf

    def start(self, now: float) -> float:
        """Schedule the first SYNC for the present time [s]; return this time."""
        self._next_sync = now
        return now

    def next_sync(self, now: float) -> float:
        """Return the due time of the next SYNC [s], at least `MIN_GAP` after commands sent now."""
        self._next_sync = max(self._next_sync, now + MIN_GAP * self._period)
        return self._next_sync

    def accept_sync(self, time: float) -> bool:
        """Return False, because another master sent this SYNC."""
        return False

    def begin(self, time: float, is_received: bool) -> int:
        """
        Begin a cycle at a time [s] and schedule the next SYNC, at least 0.8 periods later.

        Return the number of skipped periods.
        """
        skipped = 0
        if self._newest is not None:
            periods = (time - self._newest) / self._period
            skipped = max(0, int(periods + CYCLE_ROUNDING) - 1)
        self._newest = time
        in_phase = self._next_sync + self._period
        self._next_sync = max(in_phase, time + COMMANDS_DUE * self._period)
        self._waits_since = math.inf
        return skipped

    def step_due(self, sync_time: float, first_answer: float | None) -> float:
        """Return the time of the step [s]; it is late if no drive has answered."""
        if first_answer is None:
            return sync_time + FIRST_ANSWER_DUE * self._period
        due = sync_time + ANSWERS_DUE * self._period
        return max(due, first_answer + OTHERS_DUE * self._period)

    def let_sync_wait(self, now: float) -> bool:
        """Return False, because the loop receives no SYNC."""
        return False

    def let_step_wait(self, now: float, frame_time: float, due: float) -> bool:
        """
        Return whether a step due at a time [s] waits for answers that arrived in time.

        Such an answer may follow a frame that was received before the step was due. The wait
        begins with the first such frame, and lasts at most a period: frames may arrive faster than
        they are read.
        """
        if frame_time >= due:
            return False
        self._waits_since = min(self._waits_since, now)
        return now < self._waits_since + self._period

    def has_time(self, now: float) -> bool:
        """Return True, because the loop sends SYNC after its commands."""
        return True

    def causes(self, bound: int) -> list[Cause]:
        """Return no cause, because a late loop delays its SYNC instead of omitting it."""
        return []


# The clock asks the sender of SYNC what may wait. Both senders have the same methods.
SyncSender = KernelSync | LoopSync


# --- late and skipped cycles, and the time held


class CycleCounter:
    """Counter of late and skipped cycles, and of the time for which drives hold their targets."""

    def __init__(self, period: float) -> None:
        self.statistics = CycleStatistics()
        self.late_in_a_row = 0  #: late cycles with the kernel's SYNC
        #: time beyond a period for which the drives had held their target [s], whole periods
        self.held = 0.0
        self._period = period
        self._is_late = False  # whether the present cycle is counted as late
        self._late_before = 0  # late cycles before the present window
        self._commanded: float | None = None  # SYNC of the last commands that were sent

    def count_skipped(self, periods: int) -> None:
        """Count periods that passed without a SYNC."""
        self.statistics.skipped += periods

    def begin_step(self, sync_time: float, age: float, is_complete: bool) -> None:
        """Count a step that begins some time after its SYNC [s], with or without all answers."""
        counts = self.statistics
        counts.cycles += 1
        if not is_complete:
            counts.incomplete += 1
        counts.worst = max(counts.worst, age)
        if counts.cycles % LATE_WINDOW == 0:
            counts.late_share = (counts.late - self._late_before) / LATE_WINDOW
            self._late_before = counts.late

        self._is_late = False
        if self._commanded is not None:
            periods = round((sync_time - self._commanded) / self._period)
            self.held = max(0, periods - 1) * self._period

    def count_late(self, is_withdrawn: bool) -> None:
        """Count the present cycle as late, at most once; its commands may be withdrawn."""
        if self._is_late:
            return
        self._is_late = True
        self.statistics.late += 1
        if is_withdrawn:
            self.late_in_a_row += 1

    def count_commands(self, sync_time: float) -> None:
        """Record that the commands of the cycle that began with a SYNC [s] are sent."""
        self.late_in_a_row = 0
        self._commanded = sync_time

    def causes(self, bound: int) -> list[Cause]:
        """Return the cause of a stop after `bound` consecutive late cycles."""
        late = self.late_in_a_row
        if late < bound:
            return []
        message = f'the control loop was late {late} cycles in a row (limit {bound})'
        return [Cause(message, Remedy.COMPUTER)]


# --- the cycle


class CycleClock:
    """
    Clock of the cycle, for the exchange.

    The exchange calls `start` once. In each cycle it calls `receive` or `begin` with the SYNC,
    `answer` for each drive, `finish` when the step begins, and `finish_commands` when its
    commands are chosen. The period is the time between two SYNCs [s]; `drives` is the number of
    drives that answer.
    """

    JITTER_SHARE = 0.05  # share of the jitter that moves the smoothed time

    def __init__(self, period: float, drives: int, has_kernel_sync: bool) -> None:
        self.period = period
        self.sender: SyncSender = LoopSync(period)
        if has_kernel_sync:
            self.sender = KernelSync(period)
        self.counter = CycleCounter(period)
        self.is_open = False  #: whether the step of the newest SYNC has not begun
        self.next_event = math.inf  #: time of the step or of the next SYNC [s]
        self.sync_time = 0.0  #: time of the newest SYNC on the monotonic clock [s]
        self.sync_stamp = 0.0  #: the same on the system clock [s]
        #: time of the newest SYNC without its jitter [s], which would make the speed jump
        self.smooth_time = -math.inf
        self._drives = drives
        self._answers = 0  # to the newest SYNC

    @property
    def statistics(self) -> CycleStatistics:
        """Return the counters of the cycle."""
        return self.counter.statistics

    @property
    def held(self) -> float:
        """Return how much longer than a period the drives have held their targets [s]."""
        return self.counter.held

    def start(self, now: float) -> None:
        """At a time [s], expect the first SYNC of the kernel, or schedule the loop's SYNC."""
        self.sync_time = now
        self.next_event = self.sender.start(now)

    # --- SYNC

    def accept_sync(self, time: float) -> bool:
        """
        Return whether a SYNC received at a time [s] begins a cycle; then call `receive`.

        A SYNC that is too early begins no cycle. Such a SYNC comes from the kernel after an
        overdue SYNC, or from another master. Early SYNCs are counted, and too many of them are a
        cause of a stop.
        """
        return self.sender.accept_sync(time)

    def receive(self, time: float, stamp: float) -> None:
        """Begin a cycle with a SYNC received at a time [s]."""
        self._begin(time, stamp, is_received=True)

    def begin(self, time: float, stamp: float) -> None:
        """Begin a cycle with a SYNC sent by the loop, also instead of an overdue kernel SYNC."""
        self._begin(time, stamp, is_received=False)

    def _begin(self, time: float, stamp: float, is_received: bool) -> None:
        """Begin a cycle with a SYNC at a time [s] and its stamp on the system clock [s]."""
        self.counter.count_skipped(self.sender.begin(time, is_received))
        self.sync_time = time
        self.sync_stamp = stamp
        self.smooth_time = self._smoothed(time)
        self.next_event = self.sender.step_due(time, None)
        self._answers = 0
        self.is_open = True

    def _smoothed(self, time: float) -> float:
        """Return the time of a SYNC without jitter [s]; a large deviation restarts the filter."""
        if math.isinf(self.smooth_time):
            return time
        periods = round((time - self.smooth_time) / self.period)
        expected = self.smooth_time + periods * self.period
        if abs(time - expected) > JITTER * self.period:
            return time
        return expected + self.JITTER_SHARE * (time - expected)

    # --- answers

    def answer(self, now: float) -> None:
        """
        Count a drive's answer to the newest SYNC, read at a time [s].

        The last answer makes the step due. An answer after the step is ignored, because the next
        SYNC requests all answers again.
        """
        if not self.is_open:
            return
        self._answers += 1
        if self._has_all_answers:
            self.next_event = now
        elif self._answers == 1:
            self.next_event = self.sender.step_due(self.sync_time, now)

    @property
    def _has_all_answers(self) -> bool:
        return self._answers >= self._drives

    def let_wait(self, now: float, frame_time: float) -> bool:
        """
        Return whether a due step or SYNC waits until received frames are read.

        The exchange calls this method after it has read a frame that was received at `frame_time`
        [s]. A SYNC or an answer may be among the frames that are not read yet.
        """
        if not self.is_open:
            return self.sender.let_sync_wait(now)
        if self._has_all_answers:
            return False
        return self.sender.let_step_wait(now, frame_time, self.next_event)

    # --- step and commands

    def finish(self, now: float) -> bool:
        """
        Close the cycle when its step begins [s]; return whether targets may be sent.

        `finish_commands` then decides again when the targets are chosen.
        """
        self.is_open = False
        age = now - self.sync_time
        self.counter.begin_step(self.sync_time, age, self._has_all_answers)
        return self._judge(now)

    def finish_commands(self, now: float) -> bool:
        """Return whether targets chosen by the present time [s] may still be sent."""
        may_send = self._judge(now)
        if may_send:
            self.counter.count_commands(self.sync_time)
        return may_send

    def _judge(self, now: float) -> bool:
        """
        Schedule the next SYNC, and count a late cycle once.

        Return whether targets chosen at a time [s] may be sent.
        """
        self.next_event = self.sender.next_sync(now)
        if now - self.sync_time <= COMMANDS_DUE * self.period:
            return True
        self.counter.count_late(is_withdrawn=not self.sender.waits)
        return self.sender.waits

    def has_time(self, now: float) -> bool:
        """Return whether all commands sent now precede the same SYNC."""
        return self.sender.has_time(now)

    def causes(self, bound: int, is_powered: bool) -> list[Cause]:
        """Return the causes of a stop: cycle failures that occurred `bound` times."""
        causes = self.sender.causes(bound)
        if is_powered:
            causes = self.counter.causes(bound) + causes
        return causes
