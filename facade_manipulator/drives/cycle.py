"""
Clock of the cycle: due times of SYNC, of the step of the loop, and of commands.

Times on the monotonic clock [s] are arguments. A cycle is one SYNC, the answers to it, and one
step of the control loop. SYNC has one of two senders:

- The kernel's broadcast manager, where the bus offers it. Its period does not depend on the loop.
  If the step ends after `COMMANDS_DUE`, its commands would reach the drives after the next SYNC,
  and the drives would latch a double step. Such commands are not sent: the drives hold for a
  period, and the cycle counts as late. The loop sends a SYNC that is overdue. It counts the SYNCs
  that another master sends in between.
- The loop, elsewhere. It sends SYNC after its commands, at least `MIN_GAP` later. A late step
  delays SYNC instead of missing it. Any received SYNC comes from another master, because an
  interface does not return frames to their sender.
"""

from __future__ import annotations

from collections import deque
import math

from facade_manipulator.drives.snapshot import Cause, CycleStatistics, Remedy

ANSWERS_DUE = (
    0.7  # of the period after SYNC: do not wait longer for the drives' answers
)
COMMANDS_DUE = 0.8  # later commands might collide with the kernel's next SYNC
MIN_GAP = 0.2  # between our commands and our next SYNC
OTHERS_DUE = (
    0.3  # of the period: how long after a late first answer the others may come
)
FIRST_ANSWER_DUE = (
    3.0  # for the first answer: a late computer is not a loss of all drives
)
SYNC_OVERDUE, SYNC_MISSING = (
    1.5,
    2.5,
)  # of the period: with all frames read, with some waiting
SYNC_TOO_EARLY = 0.5  # of a period: an earlier SYNC begins no cycle
SURPLUS_WINDOW = 1.0  # s, in which surplus SYNCs are counted
ROUNDING = 1e-6  # periods
JITTER = (
    0.25  # of the period: a SYNC that is farther from its expected time sets a new one
)
JITTER_SHARE = 0.05  # share of the jitter that moves the smoothed time
LATE_WINDOW = 500  # cycles over which the share of late cycles is counted


class CycleClock:
    """
    Clock of one step of the control loop per SYNC of the kernel or the loop, with counters.

    `sync_time` and `sync_stamp` are those of the newest SYNC on either clock, `smooth_time` is the
    time without jitter, because jitter in the time of targets would make the speed jump.
    `is_open` is whether the step of the SYNC is still due. `next_event` is the time of the step or
    of the next SYNC [s]. `held` is the time beyond a period [s] for which the drives had held
    their command when the last commands were sent. The period is the time between two SYNCs [s];
    `drives` is the number of drives that answer.
    """

    def __init__(self, period: float, drives: int, has_kernel_sync: bool) -> None:
        self.period = period
        self.has_kernel_sync = has_kernel_sync
        self.next_event = math.inf
        self.sync_time = 0.0
        self.sync_stamp = 0.0
        self.smooth_time = -math.inf
        self.late_in_a_row = 0
        self.overdue_in_a_row = 0
        self.is_open = False
        self.held = 0.0
        self._is_counted_late = False  # whether the present step began too late
        self._drives = drives
        self._answers = 0  # to the newest SYNC
        self._commanded: float | None = (
            None  # the last SYNC after which commands were sent
        )
        self._next_sync = 0.0
        self.statistics = CycleStatistics()
        self._late_before = 0  # the present window
        self._received: deque[float] = deque()  # SYNCs of the last `SURPLUS_WINDOW` [s]
        self._waits_since = (
            math.inf
        )  # a step of our own SYNC, for frames that came before

    def start(self, now: float) -> None:
        """Expect the first SYNC of the kernel, or send the first SYNC now, at a time [s]."""
        if self.has_kernel_sync:
            self.sync_time = now
            now += SYNC_OVERDUE * self.period
        self.next_event = self._next_sync = now

    def causes(self, bound: int, is_powered: bool) -> list[Cause]:
        """Return the causes of a stop: late loop, missing or surplus SYNC, `bound` times."""
        return [
            Cause(
                f'{failure.format(count)}, the limit is {bound}',
                remedy,
                configure_again=is_lasting,
            )
            for count, failure, remedy, is_lasting in (
                (
                    self.late_in_a_row if is_powered else 0,
                    'the control loop was late {} cycles in a row',
                    Remedy.COMPUTER,
                    False,
                ),
                (
                    self.overdue_in_a_row,
                    'the kernel sent no SYNC for {} periods',
                    'check the interface and its driver',
                    True,
                ),
                (
                    self.surplus,
                    'another master is on the bus, SYNC (080h) was received '
                    f'between ours {{}} times within {SURPLUS_WINDOW:g} s',
                    Remedy.OTHER_MASTER,
                    False,
                ),
            )
            if count >= bound
        ]

    def answer(self, now: float) -> None:
        """
        Count the answer of a drive to the newest SYNC; the last answer makes the step due.

        An answer after the step is ignored, because the next SYNC requests all answers again.
        """
        self._answers += 1
        if not self.is_open:
            return
        if self._answers >= self._drives:
            self.next_event = now
        elif self._answers == 1 and not self.has_kernel_sync:
            self.next_event = max(
                self.sync_time + ANSWERS_DUE * self.period,
                now + OTHERS_DUE * self.period,
            )

    @property
    def surplus(self) -> int:
        """
        Return how many SYNCs more than those of the kernel were received in `SURPLUS_WINDOW`.

        The kernel may send a SYNC late and the next SYNC in time. Such a pair is not a surplus,
        because the time since the first SYNC of the window has room for both.
        """
        if not self._received:
            return 0
        elapsed = self._received[-1] - self._received[0]
        following = len(self._received) - 1
        return max(0, int(following - elapsed / self.period + ROUNDING))

    def is_unexpected(self, time: float) -> bool:
        """Return whether a SYNC at a time [s] is too early for the period of the kernel."""
        is_early = time < self.sync_time + SYNC_TOO_EARLY * self.period
        if is_early:
            self._count_sync(time)
        return is_early

    def receive(self, time: float, stamp: float) -> None:
        """Begin a cycle with the kernel's SYNC at a time [s]."""
        self.overdue_in_a_row = 0
        self._count_sync(time)
        self._next_sync = time + SYNC_OVERDUE * self.period
        self._open(time, stamp)

    def _count_sync(self, time: float) -> None:
        if self._received:  # an earlier time comes from a system clock that was set
            time = max(time, self._received[-1])
        self._received.append(time)
        while self._received[0] <= time - SURPLUS_WINDOW:
            self._received.popleft()

    def begin(self, time: float, stamp: float) -> None:
        """Begin a cycle with a SYNC of the loop, also if the kernel's SYNC is overdue."""
        if self.has_kernel_sync:
            self.overdue_in_a_row += 1
            self.statistics.skipped += 1
            self._next_sync = time + SYNC_OVERDUE * self.period
        else:
            self.statistics.skipped += max(
                0, int((time - self._next_sync) / self.period)
            )
            self._next_sync = (
                max(  # keep the phase, but never squeeze a cycle to catch up
                    self._next_sync + self.period, time + COMMANDS_DUE * self.period
                )
            )
            self._waits_since = math.inf
        self._open(time, stamp)

    def has_time(self, now: float) -> bool:
        """Return whether commands that are sent now all precede the same SYNC."""
        age = (now - self.sync_time) % self.period
        return not self.has_kernel_sync or age <= COMMANDS_DUE * self.period

    def may_wait(self, now: float, time: float) -> bool:
        """
        Return whether a due step or SYNC may wait until received frames are read.

        `time` is that of the last frame [s]. A SYNC or an answer may be among the frames. The wait
        is at most a period, because frames may arrive faster than they are read.
        """
        if self.has_kernel_sync and not self.is_open:
            return now < self.next_event + (SYNC_MISSING - SYNC_OVERDUE) * self.period
        if not self.is_open or self._answers >= self._drives:
            return False
        if self.has_kernel_sync:
            return now < self.next_event + (COMMANDS_DUE - ANSWERS_DUE) * self.period
        if time >= self.next_event:
            return False
        self._waits_since = min(self._waits_since, now)
        return now < self._waits_since + self.period

    def _open(self, time: float, stamp: float) -> None:
        self.sync_time, self.sync_stamp = time, stamp
        self.smooth_time = self._smoothed(time)
        self._answers = 0
        share = ANSWERS_DUE if self.has_kernel_sync else FIRST_ANSWER_DUE
        self.next_event = time + share * self.period
        self.is_open = True

    def _smoothed(self, time: float) -> float:
        """Return the time of a SYNC without its jitter [s]; a SYNC far from its time counts."""
        if math.isinf(self.smooth_time):
            return time
        periods = round((time - self.smooth_time) / self.period)
        expected = self.smooth_time + periods * self.period
        if abs(time - expected) > JITTER * self.period:
            return time
        return expected + JITTER_SHARE * (time - expected)

    def finish(self, now: float) -> bool:
        """
        Close the cycle when its step begins [s]; return whether its commands may be in time.

        `finish_commands` decides at the end of the step.
        """
        age = now - self.sync_time
        self.is_open = False
        counts = self.statistics
        counts.cycles += 1
        counts.incomplete += self._answers < self._drives
        counts.worst = max(counts.worst, age)
        if counts.cycles % LATE_WINDOW == 0:
            counts.late_share = (counts.late - self._late_before) / LATE_WINDOW
            self._late_before = counts.late
        if self._commanded is not None:
            periods = round((self.sync_time - self._commanded) / self.period)
            self.held = max(0, periods - 1) * self.period
        is_late = age > COMMANDS_DUE * self.period
        counts.late += is_late
        self._is_counted_late = is_late
        in_time = not (is_late and self.has_kernel_sync)
        if not in_time:
            self.late_in_a_row += 1
        self._wait_for_commands(now)
        return in_time

    def finish_commands(self, now: float) -> bool:
        """
        Return whether commands that were chosen until now [s] still precede the next SYNC.

        Commands that are chosen too late count like a step that begins too late.
        """
        is_late = now - self.sync_time > COMMANDS_DUE * self.period
        self.statistics.late += is_late and not self._is_counted_late
        self._wait_for_commands(now)
        if is_late and self.has_kernel_sync:
            self.late_in_a_row += not self._is_counted_late
            return False
        self.late_in_a_row = 0
        self._commanded = self.sync_time
        return True

    def _wait_for_commands(self, now: float) -> None:
        """Delay the next SYNC of the loop, so that the commands reach the drives before it."""
        if not self.has_kernel_sync:
            self._next_sync = max(self._next_sync, now + MIN_GAP * self.period)
        self.next_event = self._next_sync
