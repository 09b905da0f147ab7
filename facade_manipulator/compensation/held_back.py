"""Limits that hold axes of the head back from their path."""

from __future__ import annotations

from facade_manipulator.kinematics import Pose


class HeldBack:
    """Limits that hold axes of the head back, or held them back within the last second."""

    HOLDS = ('at the workspace limit', 'by an uncertain estimate')
    LEAST_ERROR = 1e-4  # m or rad, minimum error of an axis that counts as held back
    SHOWN_FOR = 1.0  # s, so that an operator can read the message

    def __init__(self) -> None:
        self._noted: dict[tuple[str, str], float] = {}

    def note(self, now: float, *errors: Pose) -> None:
        """Record the axes that are held back, from their errors for each of `HOLDS`."""
        for limit, error in zip(self.HOLDS, errors, strict=True):
            for axis, amount in zip(Pose._fields, error, strict=True):
                if abs(amount) > self.LEAST_ERROR:
                    self._noted[limit, axis] = now

    def message(self, now: float) -> str:
        """Return the held axes and their limits as a message, empty if no axis is held."""
        for held, then in [*self._noted.items()]:
            # a future time: the clock was set back
            if not 0.0 <= now - then < self.SHOWN_FOR:
                del self._noted[held]

        texts = []
        for limit in self.HOLDS:
            axes = [axis for axis in Pose._fields if (limit, axis) in self._noted]
            if axes:
                texts.append(f'held back in {", ".join(axes)} {limit}')
        return '; '.join(texts)
