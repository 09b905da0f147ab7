"""Driver/status: the state of the drives in a message."""

from nodes.node_rig import driver_message
import pytest

from facade_manipulator.errors import InputError
from facade_manipulator.nodes.driver_status import DriverStatus

IDLE = DriverStatus('inactive', 'holding', 'activate')


@pytest.mark.parametrize('since', ['', '?', 'nan', '-inf'])
def test_message_of_another_program_is_rejected(since):
    with pytest.raises(InputError, match='driver/status rejected'):
        DriverStatus.from_message(driver_message(IDLE._replace(active_since=since)))
