from concurrent.futures import Future
import sys
import threading

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
import pytest
from rclpy.service import Service
from std_srvs.srv import Trigger

from facade_manipulator.errors import DriveTimeoutError, ManipulatorError
from facade_manipulator.ros.lifecycle import Deferred, ManagedNode, may_defer

pytestmark = pytest.mark.quick


def answer(job):
    return Trigger.Response(success=True, message=job.result())


def test_a_deferred_answer_comes_when_its_job_is_done_and_the_node_answers_others_meanwhile(ros):
    node = ros.node('server')
    job = Future()
    may_defer(node, node.create_service(Trigger, 'slow', lambda *_: Deferred(job, answer)))
    node.create_service(Trigger, 'quick', lambda _, r: Trigger.Response(success=True))
    caller = ros.node('caller')
    slow = caller.create_client(Trigger, 'slow')
    ros.until(slow.service_is_ready, 'slow')
    pending = slow.call_async(Trigger.Request())
    assert ros.call(caller, Trigger, 'quick').success
    assert not pending.done()
    threading.Thread(target=job.set_result, args=('homed',)).start()
    ros.until(pending.done, 'the deferred answer')
    assert pending.result().message == 'homed'


def test_a_job_that_is_done_already_is_answered_too(ros):
    node = ros.node('server')
    job = Future()
    job.set_result('at once')
    may_defer(node, node.create_service(Trigger, 'done', lambda *_: Deferred(job, answer)))
    assert ros.call(ros.node('caller'), Trigger, 'done').message == 'at once'


def test_an_attached_service_may_still_answer_at_once(ros):
    node = ros.node('server')
    may_defer(node, node.create_service(
        Trigger, 'plain', lambda *_: Trigger.Response(success=False, message='no')))
    assert ros.call(ros.node('caller'), Trigger, 'plain').message == 'no'


class Machine(ManagedNode):
    """A managed node whose next jobs the test holds."""

    def __init__(self, **kwargs):
        super().__init__('machine', **kwargs)
        self.job = Future()

    def transition_jobs(self):
        return dict.fromkeys((
            State.TRANSITION_STATE_CONFIGURING, State.TRANSITION_STATE_ACTIVATING,
            State.TRANSITION_STATE_DEACTIVATING, State.TRANSITION_STATE_SHUTTINGDOWN,
        ), self._start)

    def _start(self):
        self.job = Future()
        return self.job


@pytest.fixture
def machine(ros):
    node = ros.add(Machine())
    caller = ros.node('caller')
    client = caller.create_client(ChangeState, 'machine/change_state')
    ros.until(client.service_is_ready, 'change_state')

    def change(transition, outcome=None, **by):
        before = node.job
        pending = client.call_async(
            ChangeState.Request(transition=Transition(id=transition, **by)))
        ros.until(lambda: node.job is not before or pending.done(), 'the transition to begin')
        if node.job is not before:
            during = ros.call(caller, GetState, 'machine/get_state').current_state.label
            set_outcome = (node.job.set_exception if isinstance(outcome, Exception)
                           else node.job.set_result)
            set_outcome(outcome)
            ros.until(pending.done, 'the end of the transition')
            return pending.result().success, during, node.state_label
        return pending.result().success, None, node.state_label

    change.node = node
    return change


def test_a_transition_takes_its_time_in_the_transition_state(machine):
    assert machine(Transition.TRANSITION_CONFIGURE, 'ready') == (True, 'configuring', 'inactive')
    assert machine(Transition.TRANSITION_ACTIVATE, 'on') == (True, 'activating', 'active')


def test_a_transition_is_found_by_its_label(machine):
    assert machine(0, 'ready', label='configure') == (True, 'configuring', 'inactive')
    assert machine(0, 'bye', label='shutdown') == (True, 'shuttingdown', 'finalized')


def test_a_failing_job_leaves_the_node_where_it_was(machine):
    outcome = machine(Transition.TRANSITION_CONFIGURE, DriveTimeoutError('q1 is silent'))
    assert outcome == (False, 'configuring', 'unconfigured')


@pytest.mark.parametrize('transition', [
    Transition.TRANSITION_ACTIVATE, 99, Transition.TRANSITION_CALLBACK_SUCCESS])
def test_a_transition_that_is_not_possible_now_is_rejected(machine, transition, capfd):
    assert machine(transition) == (False, None, 'unconfigured')
    said = capfd.readouterr().err
    assert '[ERROR]' in said and 'is not possible, the node is unconfigured' in said


def test_a_node_whose_drives_stopped_falls_back_to_inactive(machine):
    machine(Transition.TRANSITION_CONFIGURE, 'ready')
    machine(Transition.TRANSITION_ACTIVATE, 'on')
    machine.node.fall_back()
    assert machine.node.state_label == 'inactive'
    machine.node.fall_back()
    assert machine.node.state_label == 'inactive'


def test_who_configures_by_itself_says_once_each_what_it_waits_for_and_does_it_once(
        ros, monkeypatch, capfd):
    monkeypatch.setattr(sys.modules[ManagedNode.__module__], 'LOOKING_PERIOD', 0.01)
    node, looks = ros.add(Machine()), []
    lacking = ['no bus', 'no bus', 'no drives', '', '']
    node.configure_soon(lambda: looks.append(1) or lacking[len(looks) - 1])
    ros.until(lambda: node.state_label == 'configuring', 'the transition')
    assert len(looks) == 4
    node.job.set_result('ready')
    ros.until(lambda: node.state_label == 'inactive', 'its end')
    said = capfd.readouterr().err
    assert said.count('configure waits: no bus') == 1 and said.count('ready') == 1


def test_who_was_configured_meanwhile_is_not_configured_again(ros, machine, monkeypatch):
    monkeypatch.setattr(sys.modules[ManagedNode.__module__], 'LOOKING_PERIOD', 0.01)
    assert machine(Transition.TRANSITION_CONFIGURE, 'ready')[2] == 'inactive'
    before = machine.node.job
    machine.node.configure_soon(pytest.fail)
    *_, timer = machine.node.timers
    ros.until(timer.is_canceled, 'a look')
    assert machine.node.job is before and machine.node.state_label == 'inactive'


def test_an_rclpy_without_what_is_beyond_its_interface_ends_the_start_with_a_message(
        ros, monkeypatch):
    monkeypatch.delattr(Service, 'send_response')
    node = ros.node('server')
    with pytest.raises(ManipulatorError, match='Service of this rclpy has no send_response'):
        may_defer(node, node.create_service(Trigger, 'slow', lambda _, r: r))
