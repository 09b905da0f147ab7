"""
Let the drives run for ten minutes, fuzz them, and walk for an hour: ``make soak``.

After the run come a million random frames in simulated time, then whatever may happen in any
order (`walk`). Ends with the figures, and with exit status 1 if memory grew, a cycle was
incomplete, the drives stopped, a command was out of limits, an error was one that nobody foresaw,
or an invariant of the walk did not hold.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import suppress
import logging
import os
from pathlib import Path
import sys
import time
import traceback

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE / 'helpers')]

from command_watch import CommandWatch  # noqa: E402
from fault_rig import SITUATIONS, StreamRig  # noqa: E402
from fuzz import complaints, fuzz, RUNS  # noqa: E402
from hypothesis import Phase, settings  # noqa: E402
from hypothesis.stateful import run_state_machine_as_test  # noqa: E402
from simulated_time import SimulatedTime  # noqa: E402
from walk import Walk  # noqa: E402

from facade_manipulator.drives.controller import (  # noqa: E402
    ControllerSettings,
    ControllerState,
    CycleStatistics,
)

MOST_GROWTH = 5.0  # MB
WARM_UP = 60.0  # s: rings and caches fill
WALKS = 50
LOOK_EVERY = 0.5  # s
REPORT_EVERY = 60.0  # s
SETTINGS = ControllerSettings()
SWITCH_INTERVAL = 0.0005  # s: what are computers of their own shares one interpreter here
PRIORITY = 10  # as controller.realtime_priority, which other programs' load makes necessary


def memory() -> float:
    """Return the resident memory of this process [MB]."""
    pages = int(Path('/proc/self/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 1e6


def soak(rig: StreamRig, seconds: float) -> Iterator[str]:
    """Run the drives to and fro; yield what is wrong."""
    watch = CommandWatch(rig.axes, SETTINGS.period)
    warm_up = min(WARM_UP, seconds / 5.0)
    _run(rig, watch, warm_up)
    memory_before, before = memory(), rig.controller.snapshot().cycle
    seconds = _run(rig, watch, seconds)
    growth, snapshot = memory() - memory_before, rig.controller.snapshot()
    print(f'{seconds:.0f} s after {warm_up:.0f} s of warm-up: memory grew by {growth:.2f} MB to '
          f'{memory():.0f} MB, bound {MOST_GROWTH:g} MB\n{_cycles(snapshot.cycle, before)}\n'
          f'{watch.enabling} commands with power checked', flush=True)
    if snapshot.state is not ControllerState.ACTIVE:
        yield f'the drives are {snapshot.state.value}: {rig.all_causes}'
    if growth > MOST_GROWTH:
        yield f'memory grew by {growth:.2f} MB'
    if snapshot.cycle.incomplete > before.incomplete:
        yield f'{snapshot.cycle.incomplete - before.incomplete} cycles were incomplete'
    yield from watch.complaints


def _run(rig: StreamRig, watch: CommandWatch, seconds: float) -> float:
    """Return how long the drives have run."""
    begin = time.monotonic()
    reported = begin
    while time.monotonic() < begin + seconds and rig.state is ControllerState.ACTIVE:
        time.sleep(LOOK_EVERY)
        watch.take(rig.frames())
        if time.monotonic() > reported + REPORT_EVERY:
            reported += REPORT_EVERY
            print(f'{reported - begin:.0f} s: {memory():.1f} MB', flush=True)
    return time.monotonic() - begin


def _cycles(now: CycleStatistics, before: CycleStatistics) -> str:
    cycles, incomplete, late, skipped = (
        getattr(now, name) - getattr(before, name)
        for name in ('cycles', 'incomplete', 'late', 'skipped'))
    return (f'{cycles} cycles, {incomplete} incomplete, {late} late, {skipped} skipped; commands '
            f'at most {1e3 * now.worst:.1f} ms after SYNC; below 1, 2, 5, 10, 20, 50, 100 ms and '
            f'beyond: {now.lateness}')


def fuzz_with(frames: int) -> bool:
    """Send as many random frames, in simulated time; return whether nothing was wrong."""
    good = True
    for number, (situation, make, share) in enumerate(RUNS):
        with SimulatedTime():
            found = fuzz(situation, make, round(share * frames), number)
        good = good and not found.complaints
        print(f'{situation}, {make.__name__} frames: {round(share * frames)}, {found.enabling} '
              f'commands with power, {found.stops} stops', *found.complaints, flush=True)
    return good


def walk_for(seconds: float) -> bool:
    """Let whatever happen for a while; return whether all held, print what did not."""
    begin, walks = time.monotonic(), 0
    chosen = settings(
        max_examples=WALKS, stateful_step_count=60, deadline=None, derandomize=False,
        database=None, phases=[Phase.generate])
    try:
        while time.monotonic() < begin + seconds:
            run_state_machine_as_test(Walk, settings=chosen)
            walks += WALKS
    except AssertionError:
        traceback.print_exc()
        return False
    print(f'{walks} walks in {time.monotonic() - begin:.0f} s', flush=True)
    return True


def take_precedence() -> None:
    """Share the interpreter finely, and the processor with nobody, where that is permitted."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    with suppress(PermissionError):  # for all threads that begin after this
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))


def main() -> int:
    """Soak, fuzz and walk."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--duration', type=float, default=600.0, help='of the soak [s]')
    parser.add_argument('--frames', type=int, default=1_000_000, help='of the fuzzer')
    parser.add_argument('--walk', type=float, default=3600.0, help='time of the walk [s]')
    options = parser.parse_args()
    take_precedence()
    logging.getLogger('canopen').setLevel(logging.CRITICAL)  # aborts are no news
    with complaints() as said:
        rig = StreamRig('soak', SETTINGS)
        try:
            rig.get_ready()
            SITUATIONS['moving'](rig)
            wrong = [*soak(rig, options.duration), *said]
        finally:
            rig.close()
    print(*(f'FAILED: {message}' for message in wrong), sep='\n', flush=True)
    good = fuzz_with(options.frames)
    good = walk_for(options.walk) and good
    print('good' if good and not wrong else 'NOT GOOD')
    return 0 if good and not wrong else 1


if __name__ == '__main__':
    sys.exit(main())
