"""What a simulated drive watches while it has power: following error, switches, limits."""

from __future__ import annotations

from collections.abc import Callable

from facade_manipulator.simulation.drives.motor import (
    NEGATIVE_LIMIT,
    POSITIVE_LIMIT,
    SimulatedMotor,
)
from facade_manipulator.simulation.drives.objects import ObjectStore

FOLLOWING_ERROR = 0x8611
SOFTWARE_LIMIT = 0x8A82
LIMIT_SWITCH_ERRORS = {NEGATIVE_LIMIT: 0x8A80, POSITIVE_LIMIT: 0x8A81}

_NO_WINDOW = 0xFFFFFFFF


class SimulatedSupervision:
    """
    Checks of the motion, each against the objects that set its bounds: 6065, 6066 and 607D.

    `report` takes the code of an error.
    """

    def __init__(
        self, store: ObjectStore, motor: SimulatedMotor, report: Callable[[int], None]
    ) -> None:
        self._values = store.values
        self._motor = motor
        self._report = report
        self.reset()

    def reset(self) -> None:
        """Begin again; a switch that is on now has been so before."""
        self._late = 0.0
        self._switches = self._motor.inputs

    def forgive(self) -> None:
        """Forget how long the following error has been beyond its window."""
        self._late = 0.0

    @property
    def is_late(self) -> bool:
        """Whether the following error is beyond its window."""
        return self._late > 0.0

    def check_following(self, error: float, step: float) -> None:
        """Check a following error in counts that stood for `step` seconds."""
        window = self._values[0x6065, 0]
        is_beyond = window != _NO_WINDOW and abs(error) > window
        self._late = self._late + step if is_beyond else 0.0
        if is_beyond and self._late * 1e3 > self._values[0x6066, 0]:
            self._report(FOLLOWING_ERROR)

    def check_switches(self, is_expected: bool) -> None:
        """Check whether a limit switch has come on that is not what homing looks for."""
        inputs = self._motor.inputs
        entered, self._switches = inputs & ~self._switches, inputs
        if entered and not is_expected:
            for switch, code in LIMIT_SWITCH_ERRORS.items():
                if entered & switch:
                    self._report(code)

    def check_target(self, target: int) -> None:
        """Check a target position in counts against the software limits, if there are any."""
        low, high = self._values[0x607D, 1], self._values[0x607D, 2]
        if low < high and not low <= target <= high:
            self._report(SOFTWARE_LIMIT)
