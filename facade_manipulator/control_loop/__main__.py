"""Process that the driver node starts, with the number of its end of the channel."""

from __future__ import annotations

import logging
from logging.handlers import QueueHandler, QueueListener
import math
from queue import SimpleQueue
import signal
import socket
from typing import Any

from facade_manipulator.control_loop.channel import Channel, ChannelClosedError
from facade_manipulator.control_loop.control_loop import ControlLoop
from facade_manipulator.drives.realtime import take_over_collector
from facade_manipulator.errors import ManipulatorError

SETUP_TIMEOUT = 10.0  # s
END_TIMEOUT = 7  # s: more than the loop takes to ramp down, power off and close the bus


def main(descriptor: int) -> int:
    """Receive the setup, run the loop until the node ends it; return the exit status."""
    # a terminal's signals concern the node, which asks for an orderly end; SIGTERM asks by itself
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    take_over_collector()
    logs = _start_logging()
    channel = Channel(socket.socket(fileno=descriptor))
    try:
        message = channel.receive(SETUP_TIMEOUT)
        if message is None:
            return 1
        setup, = message[1]
        loop = ControlLoop(setup, channel)
    except ChannelClosedError:
        return 0
    except ManipulatorError as error:
        channel.send('failed', str(error))
        return 1
    else:
        signal.signal(signal.SIGTERM, lambda *_: loop.end())
        try:
            loop.serve()
        finally:
            # if anything hangs after this, the kernel ends the process
            signal.alarm(END_TIMEOUT + math.ceil(setup.extra_time))
            loop.close()
        return 0
    finally:
        logs.stop()


def _start_logging() -> QueueListener:
    """Write the log in a separate thread, because a terminal may block the output."""
    output = logging.StreamHandler()
    output.setFormatter(logging.Formatter('[%(levelname)s] [control loop]: %(message)s'))
    records: SimpleQueue[Any] = SimpleQueue()
    logging.getLogger().addHandler(QueueHandler(records))
    logging.getLogger('facade_manipulator').setLevel(logging.INFO)
    logging.getLogger('canopen').setLevel(logging.CRITICAL)  # its errors are messages of ours
    listener = QueueListener(records, output)
    listener.start()
    return listener
