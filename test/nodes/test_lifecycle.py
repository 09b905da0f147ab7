"""A managed node: transitions and requests are jobs, while other requests are answered."""

from concurrent.futures import Future
from types import SimpleNamespace

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
import pytest
from std_srvs.srv import Trigger

from facade_manipulator.errors import DriveTimeoutError
from facade_manipulator.nodes import lifecycle
from facade_manipulator.nodes.clock import steady_timer
from facade_manipulator.nodes.lifecycle import ManagedNode
from facade_manipulator.topics import Service

pytestmark = pytest.mark.quick


class Machine(ManagedNode):
    """A managed node whose jobs the test finishes."""

    def __init__(self, **kwargs):
        super().__init__('machine', **kwargs)
        self.started = []
        self.transitions = dict.fromkeys(
            ('configure', 'activate', 'deactivate', 'shutdown'), self.start)
        self.offer_job(Service(Trigger, 'machine/home'), self.start)
        steady_timer(self, 0.01, self.jobs.finish_done)

    def start(self):
        self.started.append(Future())
        return self.started[-1]


@pytest.fixture
def machine(ros):
    node, caller = ros.add(Machine()), ros.node('caller')
    client = caller.create_client(ChangeState, 'machine/change_state')
    ros.until(client.service_is_ready, 'change_state')

    def get_state():
        return ros.call(caller, GetState, 'machine/get_state').current_state.label

    def change(transition, outcome=None, **by):
        """Return success, and the states during and after the transition."""
        count = len(node.started)
        reply = client.call_async(ChangeState.Request(transition=Transition(id=transition, **by)))
        ros.until(lambda: len(node.started) > count or reply.done(), 'the transition to begin')
        during = None
        if len(node.started) > count:
            during, job = get_state(), node.started[-1]
            is_error = isinstance(outcome, Exception)
            (job.set_exception if is_error else job.set_result)(outcome)
            ros.until(reply.done, 'the end of the transition')
        return reply.result().success, during, get_state()

    return SimpleNamespace(node=node, caller=caller, change=change)


def test_transition_is_in_its_state_until_the_job_is_done(machine):
    change = machine.change
    assert change(Transition.TRANSITION_CONFIGURE) == (True, 'configuring', 'inactive')
    assert change(Transition.TRANSITION_ACTIVATE) == (True, 'activating', 'active')


def test_transition_is_found_by_its_label(machine):
    assert machine.change(0, label='configure') == (True, 'configuring', 'inactive')
    assert machine.change(0, label='shutdown') == (True, 'shuttingdown', 'finalized')


def test_failed_job_leads_back_to_the_previous_state(machine):
    outcome = machine.change(Transition.TRANSITION_CONFIGURE, DriveTimeoutError('q1 is silent'))
    assert outcome == (False, 'configuring', 'unconfigured')


@pytest.mark.parametrize('transition', [
    Transition.TRANSITION_ACTIVATE, 99, Transition.TRANSITION_CALLBACK_SUCCESS])
def test_impossible_transition_is_rejected(machine, transition, capfd):
    assert machine.change(transition) == (False, None, 'unconfigured')
    log = capfd.readouterr().err
    assert '[ERROR]' in log and 'is not possible, the node is unconfigured' in log


def test_transition_cannot_be_finished_from_outside(ros, machine):
    client = machine.caller.create_client(ChangeState, 'machine/change_state')
    ros.until(client.service_is_ready, 'change_state')
    first = client.call_async(ChangeState.Request(
        transition=Transition(id=Transition.TRANSITION_CONFIGURE)))
    ros.until(lambda: machine.node.state_label == 'configuring', 'the transition')
    assert machine.change(Transition.TRANSITION_CALLBACK_SUCCESS) == (False, None, 'configuring')
    machine.node.started[0].set_result('done')
    ros.until(first.done, 'the end of the transition')
    assert first.result().success and machine.node.state_label == 'inactive'


def test_node_falls_back_to_inactive_and_unconfigured(machine):
    machine.change(Transition.TRANSITION_CONFIGURE)
    machine.change(Transition.TRANSITION_ACTIVATE)
    for _ in range(2):
        machine.node.fall_back(to_unconfigured=False)
        assert machine.node.state_label == 'inactive'
    machine.node.fall_back(to_unconfigured=True)
    assert machine.node.state_label == 'unconfigured'


@pytest.mark.parametrize('outcome', ['homed', DriveTimeoutError('q1 is silent')])
def test_trigger_is_answered_with_the_result_of_its_job(ros, machine, outcome):
    client = machine.caller.create_client(Trigger, 'machine/home')
    ros.until(client.service_is_ready, 'home')
    reply = client.call_async(Trigger.Request())
    ros.until(lambda: machine.node.started, 'the job')
    assert ros.call(machine.caller, GetState, 'machine/get_state').current_state.id
    assert not reply.done()
    job, is_error = machine.node.started[0], isinstance(outcome, Exception)
    (job.set_exception if is_error else job.set_result)(outcome)
    ros.until(reply.done, 'the answer')
    assert (reply.result().success, reply.result().message) == (not is_error, str(outcome))


def test_node_configures_itself_once_nothing_is_missing(ros, monkeypatch, capfd):
    monkeypatch.setattr(lifecycle, 'LOOK_PERIOD', 0.01)
    node, looks = ros.add(Machine()), []
    lacking = ['no bus', 'no bus', 'no drives', '', '']
    node.configure_soon(lambda: looks.append(1) or lacking[len(looks) - 1])
    ros.until(lambda: node.state_label == 'configuring', 'the transition')
    assert len(looks) == 4
    node.started[0].set_result('ready')
    ros.until(lambda: node.state_label == 'inactive', 'its end')
    log = capfd.readouterr().err
    assert log.count('configure waits: no bus') == 1 and log.count('ready') == 1


def test_configured_node_does_not_configure_itself(ros, machine, monkeypatch):
    monkeypatch.setattr(lifecycle, 'LOOK_PERIOD', 0.01)
    assert machine.change(Transition.TRANSITION_CONFIGURE)[2] == 'inactive'
    machine.node.configure_soon(pytest.fail)
    *_, timer = machine.node.timers
    ros.until(timer.is_canceled, 'a look')
    assert len(machine.node.started) == 1 and machine.node.state_label == 'inactive'
