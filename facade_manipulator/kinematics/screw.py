"""A carriage on its screw: where the drive says it is, and where it stands on the rail."""

from __future__ import annotations

from bisect import bisect_right


class Screw:
    """
    One carriage's way from its drive's position q to its position Q on the rail.

    Q = q + offset + e(q), with e linear between the entries of the screw's table and constant
    beyond them; so the way back is exact too.

    Parameters
    ----------
    offset : float
        Q at q = 0 without the table [m].
    span : tuple of two floats
        Positions q of the first and the last entry [m].
    errors : tuple of floats
        Entries, evenly spaced [m]; a single one is constant.

    """

    def __init__(
        self, offset: float, span: tuple[float, float], errors: tuple[float, ...]
    ) -> None:
        first, last = span
        count = max(1, len(errors) - 1)
        self._driven = tuple(first + (last - first) * k / count for k in range(len(errors)))
        self._actual = tuple(
            q + offset + error for q, error in zip(self._driven, errors, strict=True))
        pieces = len(errors) - 1
        self._slopes = (1.0, *(
            (self._actual[k + 1] - self._actual[k]) / (self._driven[k + 1] - self._driven[k])
            for k in range(pieces)), 1.0)

    def actual(self, driven: float) -> float:
        """Return Q of q [m]."""
        k = bisect_right(self._driven, driven)
        near = max(k - 1, 0)
        return self._actual[near] + self._slopes[k] * (driven - self._driven[near])

    def driven(self, actual: float) -> float:
        """Return q of Q [m]."""
        k = bisect_right(self._actual, actual)
        near = max(k - 1, 0)
        return self._driven[near] + (actual - self._actual[near]) / self._slopes[k]

    def rate(self, actual: float) -> float:
        """Return dq/dQ at Q."""
        return 1.0 / self._slopes[bisect_right(self._actual, actual)]
