"""Start the demo. Ctrl-C also ends it while its modules are imported, which takes seconds."""

from __future__ import annotations

import os
import signal
from typing import NoReturn

INTERRUPTED = 130  # exit status, as of a command that Ctrl-C has ended


def main(args: list[str] | None = None) -> int:
    """Run the demo; return its exit status."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _end)
    from facade_manipulator.lab.demo.demo import main as run_demo

    return run_demo(args)


def _end(*_: object) -> NoReturn:
    """End at once: no node has been started yet."""
    os.write(2, b'demo: interrupted: nothing was started\n')
    os._exit(INTERRUPTED)


if __name__ == '__main__':
    raise SystemExit(main())
