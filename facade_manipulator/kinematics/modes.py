"""Working modes: the four solutions of the inverse kinematics."""

from __future__ import annotations

from enum import Enum


class WorkingMode(Enum):
    """
    On which side of the platform joints B1 and B2 the carriages A1 and A2 stand.

    The signs are those of the roots in eqs 7-8 of the paper: plus is towards greater x. The
    machine is built for PLUS_MINUS, both carriages inside the platform's span.
    """

    PLUS_PLUS = (1.0, 1.0)
    PLUS_MINUS = (1.0, -1.0)
    MINUS_PLUS = (-1.0, 1.0)
    MINUS_MINUS = (-1.0, -1.0)

    def __init__(self, sign1: float, sign2: float) -> None:
        # Plain attributes: Enum.value is a descriptor and costs more than the arithmetic.
        self.sign1 = sign1
        self.sign2 = sign2
