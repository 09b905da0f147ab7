"""
Run all tests and end with the totals; --check runs those that are quick and need no clock or bus.

The pure ones, on every processor, and what colcon makes of the package run beside those for which
the clock counts, and give way to them: these run two at a time, because they mostly wait, and
after them, where there is a vcan0, those that need it. Other arguments go to pytest.
"""

from __future__ import annotations

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

INTERRUPTED, NOTHING_SELECTED = 2, 5  # exit statuses of pytest
LEAST_URGENT = 19  # SCHED_IDLE would wait for strangers as well
ON_EVERY_PROCESSOR = ('--numprocesses=auto', '--dist=worksteal')
# one process more than processors, for some of the tests wait
PROMPTLY = (f'--numprocesses={len(os.sched_getaffinity(0)) + 1}', '--dist=worksteal')
PYTEST = (sys.executable, '-m', 'pytest')


class Part(NamedTuple):
    """Tests that run in one place."""

    name: str
    selection: tuple[str, ...]
    program: tuple[str, ...] = PYTEST

    def command(self, report: Path, arguments: list[str]) -> list[str]:
        """Return what runs them; of two -m pytest takes the last."""
        return [*self.program, f'--junitxml={report}', *arguments, *self.selection]


CHECK = Part('quick tests', (
    'test', '-m', 'not long and (quick or not (realtime or simulated))',
    '--hypothesis-profile=quick', *PROMPTLY))
BESIDE = (
    Part('pure tests', ('test', '-m', 'not realtime', *ON_EVERY_PROCESSOR)),
    Part('tests in a colcon workspace', (), ('.ci/colcon',)))
IN_FRONT = (
    Part('real-time tests', (
        'test', '-m', 'realtime and not vcan', '--numprocesses=2', '--dist=worksteal')),
    Part('tests of SocketCAN', ('test/processes', '-m', 'vcan'),
         (sys.executable, 'test/socketcan/vcan.py', '--silence', '180', '--', *PYTEST)))


class Result(NamedTuple):
    """What became of a part."""

    status: int
    line: str
    tried: list[str]


def give_way() -> None:
    """Leave the processors to others, also where Linux shares them by session."""
    os.nice(LEAST_URGENT)
    with suppress(OSError):  # no such sharing here
        Path('/proc/self/autogroup').write_text(str(LEAST_URGENT))


class Run:
    """A part that runs: in front, or in a session with a log of its own."""

    def __init__(self, part: Part, folder: Path, arguments: list[str], in_front: bool) -> None:
        self._part, self._begin = part, time.monotonic()
        self._report, self._log = (folder / f'{part.name}.{ending}' for ending in ('xml', 'log'))
        with open(self._log, 'w') as log:
            self._process = subprocess.Popen(
                part.command(self._report, arguments), start_new_session=not in_front,
                stdout=None if in_front else log, stderr=None if in_front else subprocess.STDOUT,
                preexec_fn=None if in_front else give_way)

    def finish(self) -> Result:
        """Wait for its end and show what it said; what Ctrl-C means is pytest's affair."""
        previous = signal.signal(signal.SIGINT, lambda *_: None)
        try:
            status = self._process.wait()
        finally:
            signal.signal(signal.SIGINT, previous)
        if said := self._log.read_text():
            print(f'\n--- {self._part.name}', said, sep='\n')
        line = f'{self._part.name}: {totals(self._report)}, ' \
            f'after {time.monotonic() - self._begin:.0f} s'
        return Result(status, line, second_tries(self._report))

    def end(self) -> None:
        """End it and all that it has started: Ctrl-C does not reach a session of its own."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGTERM)


def run_all(folder: Path, arguments: list[str]) -> list[Result]:
    """Run every part whatever the others say."""
    print(*(part.name for part in BESIDE), sep=', ', end=' run beside the others\n', flush=True)
    started = [Run(part, folder, arguments, False) for part in BESIDE]
    try:
        results = []
        for part in IN_FRONT:
            results.append(Run(part, folder, arguments, True).finish())
            if results[-1].status == INTERRUPTED:
                return results
        return [*results, *(run.finish() for run in started)]
    finally:
        for run in started:
            run.end()


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
        results = ([Run(CHECK, folder, arguments, True).finish()] if only_check
                   else run_all(folder, arguments))
    tried = [test for part in results for test in part.tried]
    print('', *(part.line for part in results), count(tried), sep='\n')
    return 0 if all(part.status in good for part in results) else 1


if __name__ == '__main__':
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit('interrupted')
