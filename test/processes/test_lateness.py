"""What a busy machine does to the tests of a bus of the kernel's."""

from __future__ import annotations

from contextlib import closing
import math

from lateness import Lateness
import pytest


def test_after_one_that_failed_on_a_late_machine_no_other_test_is_tried():
    with closing(Lateness(-1.0, 25.0)) as lateness:  # always late
        lateness.report_failure(30.0)
        with pytest.raises(pytest.fail.Exception, match='not tried'):
            lateness.require_calm()


def test_one_that_failed_for_another_reason_ends_no_other():
    with closing(Lateness(math.inf, 25.0)) as lateness:
        lateness.report_failure(30.0)
        lateness.require_calm()
