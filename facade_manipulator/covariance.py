"""
Rule for the meaning of variances in all messages.

A variance of zero means that the message contains no covariance: the value is valid, and its noise
is the default. A variance that is negative, not finite or too large marks a value that was not
measured.
"""

from __future__ import annotations

LARGEST_DEVIATION = 1.0  # m or rad, maximum noise of a sensor


def is_measured(variance: float, largest_deviation: float = LARGEST_DEVIATION) -> bool:
    """Return whether a variance marks a measured value: its deviation is at most the maximum."""
    return 0.0 <= variance <= largest_deviation**2  # false for NaN


MIN_DEVIATION = 1e-4  # m or rad; with less noise, a filter would ignore all other data


def used_variance(variance: float, default_deviation: float) -> float:
    """Return the variance to use for a measured value [m² or rad²]."""
    if variance == 0.0:
        return default_deviation**2
    return max(variance, MIN_DEVIATION**2)
