"""A managed node: transitions and requests are jobs, while other requests are answered."""

from concurrent.futures import Future

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
import pytest
from std_srvs.srv import Trigger

from facade_manipulator.errors import DriveTimeoutError
from facade_manipulator.nodes.conversions import steady_timer
from facade_manipulator.nodes.lifecycle import ManagedNode
from facade_manipulator.topics import Service

pytestmark = pytest.mark.quick
BY_ID, BY_LABEL = Transition(id=Transition.TRANSITION_CONFIGURE), Transition(label='configure')
HOME = Service(Trigger, 'machine/home')
CHANGE_STATE = Service(ChangeState, 'machine/change_state')


class Machine(ManagedNode):
    """A managed node whose jobs the test finishes."""

    def __init__(self, ros):
        super().__init__('machine')
        self.started, self.ros, self.caller = [], ros, ros.node('caller')
        self.transitions = dict.fromkeys(
            ('configure', 'activate', 'deactivate', 'shutdown'), self.start)
        self.offer(HOME, self.start)
        steady_timer(self, 0.01, self.finish_jobs)

    def start(self):
        self.started.append(Future())
        return self.started[-1]

    def request(self, service, content, outcome=None):
        """Return the response, and the state in the graph while the job is not done."""
        client, count, state = self.caller.create_client(*service), len(self.started), None
        self.ros.until(client.service_is_ready, service.name)
        reply = client.call_async(content)
        self.ros.until(lambda: len(self.started) > count or reply.done(), 'the job or the answer')
        for job in self.started[count:]:
            state = self.ros.call(self.caller, GetState, 'machine/get_state').current_state.label
            assert not reply.done()
            if isinstance(outcome, Exception):
                job.set_exception(outcome)
            else:
                job.set_result(outcome)
            self.ros.until(reply.done, 'the answer')
        return reply.result(), state

    def change(self, transition, outcome=None):
        """Return success, and the states during and after a transition."""
        reply, state = self.request(
            CHANGE_STATE, ChangeState.Request(transition=transition), outcome)
        return reply.success, state, self.state_label


@pytest.fixture
def machine(ros):
    return ros.add(Machine(ros))


@pytest.mark.parametrize('configure', [BY_ID, BY_LABEL])
def test_transition_is_in_its_state_until_job_is_done(machine, configure):
    assert machine.change(configure, DriveTimeoutError('q1 is silent')) == (
        False, 'configuring', 'unconfigured')
    assert machine.change(configure) == (True, 'configuring', 'inactive')
    assert machine.change(Transition(label='activate')) == (True, 'activating', 'active')
    for _ in range(2):
        machine.fall_back(to_unconfigured=False)
        assert machine.state_label == 'inactive'
    machine.fall_back(to_unconfigured=True)
    assert machine.state_label == 'unconfigured'
    assert machine.change(Transition(label='shutdown')) == (True, 'shuttingdown', 'finalized')


@pytest.mark.parametrize('transition', [
    Transition.TRANSITION_ACTIVATE, 99, Transition.TRANSITION_CALLBACK_SUCCESS])
def test_impossible_transition_is_rejected(machine, transition, capfd):
    assert machine.change(Transition(id=transition)) == (False, None, 'unconfigured')
    log = capfd.readouterr().err
    assert '[ERROR]' in log and 'is not possible, the node is unconfigured' in log


def test_transition_cannot_be_finished_from_outside(ros, machine):
    machine._begin(Transition.TRANSITION_CONFIGURE, lambda _: None)
    assert machine.change(Transition(id=Transition.TRANSITION_CALLBACK_SUCCESS)) == (
        False, None, 'configuring')
    machine.started[0].set_result('done')
    ros.until(lambda: machine.state_label == 'inactive', 'the end of the transition')


@pytest.mark.parametrize('outcome', ['homed', DriveTimeoutError('q1 is silent')])
def test_trigger_is_answered_with_the_result_of_its_job(machine, outcome):
    reply, state = machine.request(HOME, Trigger.Request(), outcome)
    assert (reply.success, reply.message, state) == (
        outcome == 'homed', str(outcome), 'unconfigured')
