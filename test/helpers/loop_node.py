"""
A node's side of the control loop in a process of its own, which can be killed, stopped or held up.

``python loop_node.py N`` gets the loop's setup over the socket N, gives one end of the channel
back, powers the drives on, streams, and then does what it is told over the same socket.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
import pickle
import socket
import sys

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1])]

from loop_bench import LoopBench  # noqa: E402

MUCH = 1 << 16


class RemoteLoop:
    """The process of the loop, as far as a node that never ends it needs it."""

    def wait(self, timeout: float) -> int:
        """Return at once."""
        return 0

    def kill(self) -> None:
        """Leave it to the other process."""


def hold_lock(bench: LoopBench, seconds: float) -> None:
    """Let no thread of this interpreter run, as a C library can."""
    ctypes.PyDLL(None).usleep(int(1e6 * seconds))


def send_half(bench: LoopBench) -> None:
    """Send messages that end in the middle."""
    for data in b'setpoint\0\x80\x05', b'requ', b'\0', b'limits\0' + bytes(40):
        bench.process._channel._socket.send(data)


def read_nothing(bench: LoopBench) -> None:
    """Let what the loop sends fill the channel."""
    bench.process.read = lambda: None


def main(control: socket.socket) -> None:
    """Follow the orders until the other process ends."""
    setup = pickle.loads(control.recv(MUCH))

    def hand_over(end: socket.socket) -> RemoteLoop:
        socket.send_fds(control, [b'channel'], [end.fileno()])
        return RemoteLoop()

    bench = LoopBench(setup, hand_over)
    bench.move()
    control.send(b'moving')
    while order := control.recv(MUCH):
        name, *arguments = pickle.loads(order)
        globals()[name](bench, *arguments)


if __name__ == '__main__':
    main(socket.socket(fileno=int(sys.argv[1])))
