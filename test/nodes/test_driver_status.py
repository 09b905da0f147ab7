"""Driver/status: the state of the drives in a message."""

from nodes.node_rig import driver_message
import pytest

from facade_manipulator.errors import InputError
from facade_manipulator.nodes.driver_status import DriverStatus, state_sentence

IDLE = DriverStatus('inactive', 'holding', 'activate')


@pytest.mark.parametrize('since', ['', '?', 'nan', '-inf'])
def test_message_of_another_program_is_rejected(since):
    with pytest.raises(InputError, match='driver/status rejected'):
        DriverStatus.from_message(driver_message(IDLE._replace(active_since=since)))


@pytest.mark.parametrize(
    'state, sentence',
    [
        ('active', 'the drives are active'),
        ('bus lost', 'the bus is lost'),
        ('control loop lost', 'the control loop is lost'),
        ('control loop silent', 'the control loop is silent'),
    ],
)
def test_sentence_names_the_subject_of_the_state(state, sentence):
    assert state_sentence(state) == sentence
