"""Positions of the last estimates, which may change until doubts about them have ended."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator

import numpy as np


class Positions:
    """
    Stamped positions from which the continuation and the tones learn.

    The predictor adds one for each estimate. While an axis is in doubt, its estimates may count as
    wrong. The position is then the prediction, and the error is stored separately. When the doubt
    ends and the estimates were right, the errors return to the positions.
    """

    def __init__(self) -> None:
        self._stamps: list[float] = []
        self._values: list[np.ndarray] = []
        self._left_out: list[
            np.ndarray
        ] = []  # errors of the newest, which are in doubt
        self._decided = 1  # number passed to the tones; the first is only the origin

    def add(
        self, stamp: float, values: np.ndarray, left_out: np.ndarray, is_doubted: bool
    ) -> None:
        """Add positions, and the errors left out of them as wrong [m or rad]."""
        self._stamps.append(stamp)
        self._values.append(values)
        if is_doubted:
            self._left_out.append(left_out)
        else:
            self._left_out = []

    def settle(self, is_settled: np.ndarray, were_right: np.ndarray) -> None:
        """End the doubt about settled axes; restore the errors of confirmed estimates."""
        is_returned = is_settled & were_right
        first = len(self._values) - len(self._left_out)
        for number, left_out in enumerate(self._left_out):
            returned = np.where(is_returned, left_out, 0.0)
            self._values[first + number] = self._values[first + number] + returned
            self._left_out[number] = np.where(is_settled, 0.0, left_out)

    def decided(self, before: float) -> Iterator[tuple[float, np.ndarray]]:
        """Yield each position with an earlier stamp [s] in order, and only once."""
        while (
            self._decided < len(self._stamps) and self._stamps[self._decided] < before
        ):
            yield self._stamps[self._decided], self._values[self._decided]
            self._decided += 1

    def since(self, stamp: float) -> np.ndarray:
        """Return all positions with this or a later stamp [s], shape (axes, number) [m or rad]."""
        return np.array(self._values[bisect_left(self._stamps, stamp) :]).T

    def forget(self, before: float) -> None:
        """Delete all positions with an earlier stamp [s]."""
        count = bisect_left(self._stamps, before)
        del self._stamps[:count]
        del self._values[:count]
        self._decided = max(self._decided - count, 0)
        excess = len(self._left_out) - len(self._values)
        del self._left_out[: max(excess, 0)]
