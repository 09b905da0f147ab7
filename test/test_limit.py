"""A test that hangs is ended by its name."""

import pytest
from support import HangingTestError, limited, patiently, wait_until

pytestmark = pytest.mark.realtime


def test_what_hangs_is_ended_where_it_waits_and_not_tried_again():
    tries = []
    with pytest.raises(HangingTestError, match='it takes over 0.05 s'), limited('it', 0.05):
        patiently(lambda: (tries.append(1), wait_until(lambda: False, 'nothing')))
    assert len(tries) == 1
