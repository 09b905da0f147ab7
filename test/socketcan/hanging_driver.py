"""The driver node, whose executor hangs when it gets SIGUSR1."""

import signal
import sys
import time

from facade_manipulator.nodes.driver import main

if __name__ == '__main__':
    signal.signal(signal.SIGUSR1, lambda *_: time.sleep(3600.0))  # in the executor's thread
    sys.exit(main())
