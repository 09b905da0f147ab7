"""Positions of estimates in doubt, which return when the doubt ends."""

import numpy as np

from facade_manipulator.prediction.positions import Positions

ORIGIN = np.zeros(2)
VALUES = np.array([1.0, 2.0])
ERRORS = np.array([0.5, 0.25])

BOTH = np.array([True, True])
NONE = np.array([False, False])


def doubted():
    """Return positions whose newest is in doubt along both axes."""
    positions = Positions()
    positions.add(0.0, ORIGIN, np.zeros(2), False)
    positions.add(1.0, VALUES, ERRORS, True)
    return positions


def test_errors_of_confirmed_estimates_are_restored_once():
    positions = doubted()
    for _ in range(2):
        positions.settle(np.array([True, False]), BOTH)
    assert positions.since(1.0).tolist() == [[1.5], [2.0]]


def test_errors_of_wrong_estimates_never_return():
    positions = doubted()
    positions.settle(BOTH, NONE)
    positions.settle(BOTH, BOTH)
    assert positions.since(1.0).tolist() == [[1.0], [2.0]]


def test_given_arrays_are_never_changed():
    doubted().settle(BOTH, BOTH)
    assert VALUES.tolist() == [1.0, 2.0]
    assert ERRORS.tolist() == [0.5, 0.25]


def test_each_decided_position_is_passed_once():
    positions = doubted()
    assert list(positions.decided(1.0)) == []
    assert [stamp for stamp, _ in positions.decided(1.5)] == [1.0]
    assert list(positions.decided(2.0)) == []


def test_forgotten_positions_do_not_shift_the_doubt():
    positions = doubted()
    positions.add(2.0, VALUES, ERRORS, True)
    positions.forget(2.0)
    positions.settle(BOTH, BOTH)
    assert positions.since(0.0).tolist() == [[1.5], [2.25]]
