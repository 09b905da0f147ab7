"""
The cubic spline through points of time: slopes with which the acceleration has no jumps.

References
----------
C. de Boor, A Practical Guide to Splines, Springer 1978, chapter IV: complete spline interpolation.

"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from facade_manipulator.motion.limits import Triple


def inner_slopes(
    times: Sequence[float], points: Sequence[Triple], first: Triple, last: Triple
) -> list[Triple]:
    """
    Return the slopes at the inner points of the cubic spline with given slopes at its ends.

    Parameters
    ----------
    times : sequence of float, shape (n,)
        Rising.
    points : sequence of tuples of float, shape (n, 3)
    first, last : tuple of float, shape (3,)
        Slopes at the first and the last point.

    Returns
    -------
    list of tuples of float, shape (n - 2, 3)

    """
    rates = [1.0 / (b - a) for a, b in pairwise(times)]
    # Elimination from the front: a slope is a part less a share of the next one.
    parts, shares = [first], [0.0]
    for k, (before, after) in enumerate(pairwise(rates), start=1):
        pivot = 2.0 * (before + after) - before * shares[-1]
        bend, push, pull = 3.0 / pivot, before * before, after * after
        parts.append(tuple([
            bend * (push * (b - a) + pull * (c - b)) - before / pivot * part
            for a, b, c, part in zip(*points[k - 1:k + 2], parts[-1], strict=True)]))
        shares.append(after / pivot)
    slopes = [last]
    for part, share in zip(parts[:0:-1], shares[:0:-1], strict=True):
        slopes.append(tuple([p - share * s for p, s in zip(part, slopes[-1], strict=True)]))
    return slopes[:0:-1]
