"""
Run all tests, those of test/socketcan where there is a vcan0; end with the totals.

Arguments go to pytest.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree

TOP = Path(__file__).resolve().parents[1]
INTERRUPTED, NOTHING_SELECTED = 2, 5  # exit statuses of pytest
sys.path.insert(0, str(TOP / 'test' / 'socketcan'))

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


PARTS: tuple[tuple[str, Callable, list[str]], ...] = (
    ('tests', on_the_host, ['test', '--ignore=test/socketcan']),
    ('tests of SocketCAN', on_a_vcan, ['test/socketcan']),
)


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
    """Run every part whatever the others say; return 0 where all of them passed."""
    good = (0, NOTHING_SELECTED) if arguments else (0,)  # arguments may select tests
    lines, statuses, tried = [], [], []
    with tempfile.TemporaryDirectory(dir=sys.prefix) as folder:
        for number, (name, where, selection) in enumerate(PARTS):
            report, start = Path(folder, f'{number}.xml'), time.monotonic()
            place, status = where([sys.executable, '-m', 'pytest', f'--junitxml={report}',
                                   *selection, *arguments])
            statuses.append(status)
            lines.append(f'{name}: {totals(report)} in {time.monotonic() - start:.0f} s ({place})')
            tried += second_tries(report)
            if status == INTERRUPTED:
                break
    print('', *lines, count(tried), sep='\n')
    return 0 if all(status in good for status in statuses) else 1


if __name__ == '__main__':
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit('interrupted')
