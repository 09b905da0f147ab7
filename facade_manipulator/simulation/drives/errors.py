"""
The errors of a simulated drive, present and past.

References
----------
CiA 301, emergency object, objects 1001h and 1003h.

"""

from __future__ import annotations

from collections import deque
from functools import partial

from canopen import SdoAbortedError
from canopen.sdo import constants

from facade_manipulator.simulation.drives.objects import ObjectStore

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


class ErrorHistory:
    """Errors that are present, and those that were: 603F, 1001 and 1003."""

    def __init__(self, store: ObjectStore) -> None:
        self._present: dict[int, bool] = {}
        self._past: deque[int] = deque(maxlen=8)
        store.readers[0x1001, 0] = lambda: self.register
        store.readers[0x603F, 0] = lambda: self.code
        store.readers[0x1003, 0] = lambda: len(self._past)
        store.writers[0x1003, 0] = self._clear_past
        for subindex in range(1, 9):
            store.readers[0x1003, subindex] = partial(self._entry, subindex)

    def _entry(self, subindex: int) -> int:
        return self._past[subindex - 1] if subindex <= len(self._past) else 0

    def _clear_past(self, value: int) -> None:
        if value:
            raise SdoAbortedError(constants.ABORT_INVALID_VALUE)
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
