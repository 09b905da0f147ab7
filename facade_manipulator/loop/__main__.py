"""The process that the driver node starts, with the number of its end of the channel."""

from __future__ import annotations

import logging
import signal
import socket
import sys

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.loop.channel import Channel, ChannelClosedError
from facade_manipulator.loop.control_loop import ControlLoop

SETUP_TIMEOUT = 10.0  # s


def main(descriptor: int) -> int:
    """Receive the setup, run the loop until the node ends or asks; return the exit status."""
    # the node receives a terminal's signals and asks for an orderly end; SIGTERM asks by itself
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    logging.basicConfig(format='[%(levelname)s] [control loop]: %(message)s')
    logging.getLogger('facade_manipulator').setLevel(logging.INFO)
    channel = Channel(socket.socket(fileno=descriptor))
    try:
        message = channel.receive(SETUP_TIMEOUT)
    except ChannelClosedError:
        return 0
    if message is None:
        return 1
    try:
        loop = ControlLoop(*message.content, channel)
    except ManipulatorError as error:
        channel.send('failed', str(error), must_arrive=True)
        return 1
    signal.signal(signal.SIGTERM, lambda *_: loop.end())
    loop.serve()
    return 0


if __name__ == '__main__':
    sys.exit(main(int(sys.argv[1])))
