"""L1: late and missed cycles of the demo at 100 Hz, with and without real-time priority."""

from contextlib import contextmanager
from functools import partial
import json
from pathlib import Path
import subprocess
import sys
from tempfile import TemporaryDirectory

from own_processes import forbid_priority

CYCLES = 10_000  # to which the counts refer
DURATION = 25.0  # s of strokes; a count is of some 2,600 cycles
QUICK_DURATION = 5.0  # s
BUSY_PROGRAMS = 2
MOST = 2  # missed cycles of 10,000 with priority


@contextmanager
def busy_programs(count):
    """Run programs that use a processor each, until the end of the context."""
    programs = [
        subprocess.Popen([sys.executable, '-c', 'while True: pass'])
        for _ in range(count)
    ]
    try:
        yield
    finally:
        for program in programs:
            program.kill()
            program.wait()


def count(prepare, programs, duration):
    """
    Run the demo after a preparation of its process; count late and missed cycles of 10,000.

    The result is the priority of the control loop, and both counts.

    A demo whose drives stop, because its cycles are too late, counts as all missed.
    """
    with TemporaryDirectory() as folder, busy_programs(programs):
        command = ['demo', '--duration', str(duration), '--output', folder]
        ended = subprocess.run(
            command, preexec_fn=prepare, capture_output=True, text=True, check=False
        )
        summary = Path(folder) / 'summary.json'
        if not summary.exists():
            print(ended.stderr.strip())
            return 0, CYCLES, CYCLES
        counts = json.loads(summary.read_text())
    scale = CYCLES / counts['bus_cycles']
    return (
        counts['realtime_priority'],
        scale * counts['late_cycles'],
        scale * counts['missed_cycles'],
    )


def rows(quick):
    """Compare the counts with priority to those without, idle and beside busy programs."""
    duration = QUICK_DURATION if quick else DURATION
    for condition, programs in (
        ('idle', 0),
        (f'beside {BUSY_PROGRAMS} busy programs', BUSY_PROGRAMS),
    ):
        measure = partial(count, programs=programs, duration=duration)
        priority, late, missed = measure(None)
        _, late_without, missed_without = measure(forbid_priority)
        if not priority:
            print(f'L1 {condition}: this account may not use real-time priority')
        for name, ours, without, goal in (
            ('missed', missed, missed_without, MOST),
            ('late', late, late_without, None),
        ):
            yield {
                'name': f'L1 {name} cycles of {CYCLES}, {condition}: with / without priority',
                'ours': ours,
                'competitor': without,
                'unit': '1',
                'ratio': ours / without if without else 1.0,
                'goal': '-' if goal is None else f'<= {goal} missed',
                'met': goal is None or (priority > 0 and ours <= goal),
            }
