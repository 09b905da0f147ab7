"""The driver node, whose executor hangs when it gets SIGUSR1 and says since when."""

import signal
import sys
import time

from facade_manipulator.nodes.driver import main


def hang(*_: object) -> None:
    """Stop the thread that runs the executor, as a callback without end would."""
    print(f'hung at {time.time()}', flush=True)
    time.sleep(3600.0)


if __name__ == '__main__':
    signal.signal(signal.SIGUSR1, hang)
    sys.exit(main())
