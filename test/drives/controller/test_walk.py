"""Requests, faults, events on the bus, clock steps and changes in any order, with invariants."""

from hypothesis import settings
from hypothesis.stateful import run_state_machine_as_test
import pytest
from walk import Walk


@pytest.mark.long
def test_whatever_happens_the_machine_is_safe_and_the_next_step_works():
    run_state_machine_as_test(Walk, settings=settings(max_examples=30, stateful_step_count=30))
