"""Keys of a dead man: a key counts as held for as long as the terminal repeats it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import os
import select
import sys
import termios
import time
import tty

HELD = 0.08  # s: a terminal repeats a held key every 20 to 50 ms, after 250 ms or more at first
_KEYS = {b'\x1b[C': 1, b'd': 1, b'\x1b[D': -1, b'a': -1}
_END = (b'q', b'\x03', b'\x04')


class HeldKeys:
    """The direction that a held key of a terminal, or a pipe, gives; none means stop."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._direction = 0
        self._time = 0.0
        self.is_ended = False

    def direction(self) -> int:
        """Return 1 or −1 while a key is held, else 0; a closed terminal ends it."""
        while not self.is_ended and select.select([self._descriptor], [], [], 0.0)[0]:
            self._take(self._read())
        return self._direction if time.monotonic() - self._time < HELD else 0

    def _read(self) -> bytes:
        try:
            return os.read(self._descriptor, 64)
        except OSError:
            return b''  # the terminal is gone

    def _take(self, data: bytes) -> None:
        if not data or any(end in data for end in _END):
            self.is_ended, self._direction = True, 0
            return
        last = max(_KEYS, key=data.rfind)
        # any other key stops
        self._direction = _KEYS[last] if last in data else 0
        self._time = time.monotonic()


@contextmanager
def held_keys() -> Iterator[HeldKeys]:
    """Lend the keys of this terminal, unechoed and at once."""
    descriptor = sys.stdin.fileno()
    if not os.isatty(descriptor):
        yield HeldKeys(descriptor)
        return
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)
    try:
        yield HeldKeys(descriptor)
    finally:
        with suppress(termios.error):  # the terminal is gone
            termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
