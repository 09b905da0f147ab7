"""Causes that keep the head, or axes of it, from following their path."""

from __future__ import annotations

from facade_manipulator.errors import joined, NEXT
from facade_manipulator.kinematics import Pose


class HeldBack:
    """Causes that hold the head back now, or did so within the last second."""

    # limits that hold axes of the head, with the next step of the operator
    HOLDS = {
        'at the workspace limit': 'choose a goal nearer to the middle of the workspace',
        'by an uncertain estimate': 'check the sensor',
    }
    LEAST_ERROR = 1e-4  # m or rad, minimum error of an axis that counts as held back
    SHOWN_FOR = 1.0  # s, so that an operator can read the message
    OFF_PATH = 'the head does not follow its path; next: check /diagnostics'

    def __init__(self) -> None:
        # newest time of each cause and axis [s]; the head off its path has no axis
        self._noted: dict[tuple[str, str], float] = {}

    def note(self, now: float, *errors: Pose) -> None:
        """Record which axes are held back, from the axis errors for each entry of `HOLDS`."""
        for limit, error in zip(self.HOLDS, errors, strict=True):
            for axis, amount in zip(Pose._fields, error, strict=True):
                if abs(amount) > self.LEAST_ERROR:
                    self._noted[limit, axis] = now

    def note_off_path(self, now: float) -> None:
        """Record that the head has not followed its path, for example after rejected setpoints."""
        self._noted[self.OFF_PATH, ''] = now

    def message(self, now: float) -> str:
        """
        Return the held axes, their causes and the next steps in one message.

        The message is empty if the head is not held.
        """
        for held, then in [*self._noted.items()]:
            # a future time: the clock was set back
            if not 0.0 <= now - then < self.SHOWN_FOR:
                del self._noted[held]

        texts = []
        for limit, step in self.HOLDS.items():
            axes = [axis for axis in Pose._fields if (limit, axis) in self._noted]
            if axes:
                texts.append(f'held back in {", ".join(axes)} {limit}{NEXT}{step}')
        if (self.OFF_PATH, '') in self._noted:
            texts.append(self.OFF_PATH)
        return joined(*texts)
