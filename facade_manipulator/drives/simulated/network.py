"""
What a simulated drive keeps of its network: the master's heartbeat and the history of errors.

References
----------
CiA 301, heartbeat consumer, emergency object, objects 1001h and 1003h.

"""

from __future__ import annotations

from collections import deque
import math

from canopen import SdoAbortedError

from facade_manipulator.drives.canopen import pdo
from facade_manipulator.drives.simulated.objects import INVALID_VALUE, ObjectStore

# which bit of the error register 1001 a code sets besides the generic one; narrow masks first
_ERROR_REGISTER = (
    (0xF000, 0x2000, 0x02),
    (0xF000, 0x3000, 0x04),
    (0xF000, 0x4000, 0x08),
    (0xFF00, 0x8100, 0x10),
    (0xFF00, 0x8200, 0x10),
    (0xF000, 0x8000, 0x20),
    (0xF000, 0x7000, 0x20),
    (0xFF00, 0xFF00, 0x80),
)
_GENERIC_ERROR = 0x01


class HeartbeatConsumer:
    """
    Watches the master's heartbeat, as 1016:01 says, from the first one on.

    Attributes
    ----------
    deadline : float
        When the master counts as dead; infinity before its first heartbeat.
    lost : bool
        Whether it counts as dead.

    """

    def __init__(self, store: ObjectStore) -> None:
        self._values = store.values
        self.forget()

    def forget(self) -> None:
        """Wait for a first heartbeat."""
        self.deadline = math.inf
        self.lost = False

    @property
    def cob_id(self) -> int | None:
        """COB-ID of the watched heartbeat, None if none is watched."""
        entry = self._values[0x1016, 1]
        node, time_out = entry >> 16 & 0xFF, entry & 0xFFFF
        return pdo.heartbeat_cob_id(node) if time_out and 0 < node < 0x80 else None

    def receive(self, now: float) -> bool:
        """Note a heartbeat; return whether the master had counted as dead."""
        self.deadline = now + (self._values[0x1016, 1] & 0xFFFF) * 1e-3
        was_lost, self.lost = self.lost, False
        return was_lost

    def is_overdue(self, now: float) -> bool:
        """Return, once, that the master has died."""
        if now < self.deadline:
            return False
        self.deadline, self.lost = math.inf, True
        return True


class ErrorHistory:
    """
    Errors that are present, and those that were: 603F, 1001 and 1003.

    Attributes
    ----------
    code : int
        The last error that came, 0 if none is present.

    """

    def __init__(self, store: ObjectStore) -> None:
        self._present: dict[int, bool] = {}
        self._past: deque[int] = deque(maxlen=8)
        store.readers[0x1001, 0] = lambda: self.register
        store.readers[0x603F, 0] = lambda: self.code
        store.readers[0x1003, 0] = lambda: len(self._past)
        store.writers[0x1003, 0] = self._clear_past
        for subindex in range(1, 9):
            store.readers[0x1003, subindex] = lambda n=subindex: self._entry(n)

    def _entry(self, subindex: int) -> int:
        return self._past[subindex - 1] if subindex <= len(self._past) else 0

    def _clear_past(self, value: int) -> None:
        if value:
            raise SdoAbortedError(INVALID_VALUE)
        self._past.clear()

    @property
    def code(self) -> int:
        """The error that came last of those present, 0 for none."""
        return next(reversed(self._present), 0)

    @property
    def register(self) -> int:
        """The error register 1001."""
        register = 0
        for code in self._present:
            register |= _register(code)
        return register

    def __contains__(self, code: int) -> bool:
        return code in self._present

    def add(self, code: int, persistent: bool) -> None:
        """Note an error; a persistent one stays until `remove_causes`."""
        self._present.pop(code, None)
        self._present[code] = persistent
        self._past.appendleft(code)

    def remove_causes(self) -> None:
        """Make all present errors ones that a reset clears: their cause is gone."""
        self._present = dict.fromkeys(self._present, False)

    def discard(self, code: int) -> None:
        """Forget a present error."""
        self._present.pop(code, None)

    def reset(self) -> bool:
        """Forget the errors whose cause is gone; return whether none is left."""
        self._present = {code: True for code, persistent in self._present.items() if persistent}
        return not self._present

    def forget(self) -> None:
        """Forget everything, as when the power goes."""
        self._present.clear()
        self._past.clear()


def _register(code: int) -> int:
    for mask, value, bit in _ERROR_REGISTER:
        if code & mask == value:
            return bit | _GENERIC_ERROR
    return _GENERIC_ERROR
