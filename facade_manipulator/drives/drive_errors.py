"""Errors and warnings that one drive reports in emergency messages or in 603Fh."""

from __future__ import annotations

from collections.abc import Mapping

from facade_manipulator.canopen.bus import Frame
from facade_manipulator.canopen.emcy import error_code, Fault, fault, is_error_reset
from facade_manipulator.drives.encoder import Encoder
from facade_manipulator.drives.snapshot import Cause


class DriveErrors:
    """
    Last error and warning of one drive.

    An error that makes the position invalid also marks the encoder position as lost. `meanings`
    are the maker's own meanings of error codes.
    """

    def __init__(
        self, name: str, title: str, meanings: Mapping[str, Fault], encoder: Encoder
    ) -> None:
        self._name = name
        self._title = title
        self._meanings = meanings
        self._encoder = encoder
        self.forget()

    def forget(self) -> None:
        """Forget the errors and warnings of the drive."""
        #: the last error code; 0 for none, or after the drive has reset it
        self.code = 0
        self.message = ''  #: the same as a message
        #: the warning of the drive and its remedy, ``''`` for none
        self.warning = ''

    def receive_emergency(self, frame: Frame) -> Cause | None:
        """
        Receive an emergency message; return the cause of a stop, or None if harmless.

        A drive that faults in spite of a code that its maker calls a warning shows the fault in
        its statusword.
        """
        code = error_code(frame.data)
        if is_error_reset(code):
            self.forget()
            return None
        meaning = fault(code, self._meanings)
        if meaning.is_warning:
            self.warning = f'it reports a warning: {meaning.message}: {meaning.remedy}'
            return None
        return self._receive(code, meaning)

    def receive_code(self, code: int) -> Cause | None:
        """Receive error code 603Fh of a drive in fault; return the cause if the error is new."""
        if code == self.code or is_error_reset(code):
            return None
        return self._receive(code, fault(code, self._meanings))

    def _receive(self, code: int, meaning: Fault) -> Cause:
        """Store an error with its meaning; return the cause of a stop."""
        self.code = code
        self.message = meaning.message
        if meaning.loses_position:
            self._encoder.distrust()
        return Cause(
            f'{self._title}: {self.message}',
            meaning.remedy,
            self._name,
            cut_power=meaning.loses_position,
        )
