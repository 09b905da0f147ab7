"""One topic of the estimates: a second topic is rejected until the first is silent."""

import pytest

from facade_manipulator.compensation.correction import ESTIMATOR_SILENCE
from facade_manipulator.compensation.estimate_source import EstimateSource
from facade_manipulator.errors import InputError

FAULT = (
    'estimates arrive on 2 topics (disturbance, disturbance_odometry), above the limit 1; '
    'next: end one of the nodes'
)


@pytest.fixture
def source():
    """Return a source whose topic is disturbance since 10 s."""
    source = EstimateSource()
    source.require_sole(10.0, 'disturbance')
    source.accept(10.0, 'disturbance')
    return source


def test_second_topic_is_rejected_with_both_names(source):
    with pytest.raises(InputError) as caught:
        source.require_sole(10.01, 'disturbance_odometry')
    assert caught.value.reason == 'publishers'
    assert str(caught.value) == source.fault(10.02) == FAULT
    source.require_sole(10.02, 'disturbance')


def test_second_topic_is_accepted_after_a_silence(source):
    with pytest.raises(InputError):
        source.require_sole(10.4, 'disturbance_odometry')
    now = 10.0 + 1.01 * ESTIMATOR_SILENCE
    source.require_sole(now, 'disturbance_odometry')
    source.accept(now, 'disturbance_odometry')
    assert source.fault(now) == ''
    with pytest.raises(InputError):
        source.require_sole(now + 0.1, 'disturbance')


def test_rejected_topic_does_not_exclude_the_other():
    source = EstimateSource()
    source.require_sole(10.0, 'disturbance')  # its estimate is then impossible
    source.require_sole(10.01, 'disturbance_odometry')
    assert source.fault(10.01) == ''
