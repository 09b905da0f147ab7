"""
Run all tests and end with the totals; --check runs the quick ones that need no clock, bus or ROS.

The pure ones run on every processor, beside what colcon makes of the package, and give way to the
others: those for which the clock counts, two at a time because they mostly wait, then those of
test/socketcan where there is a vcan0. Other arguments go to pytest.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import time
from typing import NamedTuple
import xml.etree.ElementTree as ElementTree

TOP = Path(__file__).resolve().parents[1]
INTERRUPTED, NOTHING_SELECTED = 2, 5  # exit statuses of pytest
LEAST_URGENT = 19  # SCHED_IDLE would wait for strangers as well
ON_EVERY_PROCESSOR = ('--numprocesses=auto', '--dist=worksteal')
sys.path.insert(0, str(TOP / 'test' / 'socketcan'))
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')  # for there is a process for each processor

import guest  # noqa: E402
import vcan  # noqa: E402


def on_the_host(command: list[str]) -> tuple[str, int]:
    """Run a command as it is; return where that was and its exit status."""
    return 'this machine', vcan.call(command)


def on_a_vcan(command: list[str]) -> tuple[str, int]:
    """Run a command beside a vcan0; a guest that failed counts as a failed command."""
    try:
        return vcan.run(command)
    except guest.GuestError as error:
        print(f'guest: {error}', file=sys.stderr)
        return f'user-mode Linux, which failed: {str(error).splitlines()[0]}', 1


class Part(NamedTuple):
    """Tests that run in one place."""

    name: str
    where: Callable[[list[str]], tuple[str, int]]
    selection: tuple[str, ...]
    program: tuple[str, ...] = (sys.executable, '-m', 'pytest')

    def command(self, report: Path, arguments: list[str]) -> list[str]:
        """Return what runs them; of two -m pytest takes the last."""
        return [*self.program, f'--junitxml={report}', *arguments, *self.selection]


class Result(NamedTuple):
    """What became of a part."""

    status: int
    line: str
    tried: list[str]


PURE = Part('pure tests', on_the_host, (
    'test', '-m', 'not realtime', *ON_EVERY_PROCESSOR))
CHECK = Part('quick tests', on_the_host, (
    'test', '-m', 'not realtime and not long and not simulated', '--hypothesis-profile=quick',
    *ON_EVERY_PROCESSOR))
BESIDE = (PURE, Part('tests in a colcon workspace', on_the_host, (), ('.ci/colcon',)))
IN_TURN = (
    Part('real-time tests', on_the_host, (
        'test', '--ignore=test/socketcan', '-m', 'realtime', '--numprocesses=2',
        '--dist=worksteal')),
    Part('tests of SocketCAN', on_a_vcan, ('test/socketcan',)),
)


def run(part: Part, folder: Path, arguments: list[str]) -> Result:
    """Run a part and wait for it."""
    report, start = folder / f'{part.name}.xml', time.monotonic()
    place, status = part.where(part.command(report, arguments))
    return result(part, status, report, f'in {time.monotonic() - start:.0f} s ({place})')


def result(part: Part, status: int, report: Path, circumstances: str) -> Result:
    """Sum up a part."""
    line = f'{part.name}: {totals(report)} {circumstances}'
    return Result(status, line, second_tries(report))


def run_all(folder: Path, arguments: list[str]) -> list[Result]:
    """Run every part whatever the others say."""
    print(*(part.name for part in BESIDE), sep=', ', end=' run beside the others\n', flush=True)
    started = [Background(part, folder, arguments) for part in BESIDE]
    results = []
    try:
        for part in IN_TURN:
            results.append(run(part, folder, arguments))
            if results[-1].status == INTERRUPTED:
                break
        needed = results[-1].status != INTERRUPTED
        return [part.finish(needed) for part in started] + results
    finally:
        for part in started:
            part.end()


def give_way() -> None:
    """Leave the processors to others, also where Linux shares them by session."""
    os.setsid()
    os.nice(LEAST_URGENT)
    with suppress(OSError):  # no such sharing here
        Path('/proc/self/autogroup').write_text(str(LEAST_URGENT))


class Background:
    """A part that leaves the processors to the others, and says at its end what it has to say."""

    def __init__(self, part: Part, folder: Path, arguments: list[str]) -> None:
        self._part = part
        self._report, self._log = (folder / f'{part.name}.{ending}' for ending in ('xml', 'log'))
        with open(self._log, 'w') as log:
            self._process = subprocess.Popen(
                part.command(self._report, arguments), stdout=log, stderr=subprocess.STDOUT,
                preexec_fn=give_way)

    def finish(self, is_needed: bool) -> Result:
        """Wait for its end, or end it, and show what it said."""
        if not is_needed:
            self.end()
        status = self._process.wait()
        print(f'\n--- {self._part.name}', self._log.read_text(), sep='\n')
        return result(self._part, status, self._report, 'beside the others (this machine)')

    def end(self) -> None:
        """End it and all that it has started: Ctrl-C does not reach a session of its own."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGTERM)


def totals(report: Path) -> str:
    """Sum up what pytest reported."""
    if not report.exists():
        return 'no result'
    suites = list(ElementTree.parse(report).iter('testsuite'))
    counts = {key: sum(int(suite.get(key)) for suite in suites)
              for key in ('tests', 'failures', 'errors', 'skipped')}
    failed = counts['failures'] + counts['errors']
    passed = counts['tests'] - failed - counts['skipped']
    return f'{passed} passed, {failed} failed, {counts["skipped"]} skipped'


def second_tries(report: Path) -> list[str]:
    """Return which tests passed or failed only after they were tried again."""
    cases = ElementTree.parse(report).iter('testcase') if report.exists() else ()
    return [case.get('name') for case in cases
            if any(item.get('name') == 'second try' for item in case.iter('property'))]


def count(tried: list[str]) -> str:
    """Say how many tests needed a second try, and which."""
    tests = 'no test' if not tried else '1 test' if len(tried) == 1 else f'{len(tried)} tests'
    return f'{tests} needed a second try' + (f': {", ".join(tried)}' if tried else '')


def main(arguments: list[str]) -> int:
    """Return 0 where all parts passed."""
    only_check, arguments = '--check' in arguments, [a for a in arguments if a != '--check']
    good = (0, NOTHING_SELECTED) if arguments else (0,)  # arguments may select tests
    with tempfile.TemporaryDirectory(dir=sys.prefix) as name:
        folder = Path(name)
        results = [run(CHECK, folder, arguments)] if only_check else run_all(folder, arguments)
    tried = [test for part in results for test in part.tried]
    print('', *(part.line for part in results), count(tried), sep='\n')
    return 0 if all(part.status in good for part in results) else 1


if __name__ == '__main__':
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit('interrupted')
