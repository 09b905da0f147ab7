import pytest

from facade_manipulator.drives import axis
from facade_manipulator.drives.axis import AxisStepper, Feedback, Step
from facade_manipulator.drives.states import Mode, State, STATUSWORDS
from facade_manipulator.errors import DriveError, DriveStateError, DriveTimeoutError
from facade_manipulator.simulation.drives.automaton import decode_command, TRANSITIONS

CSP = Mode.CYCLIC_SYNCHRONOUS_POSITION
PLANS = {
    'power on': (axis.power_on(CSP), State.SWITCH_ON_DISABLED, State.OPERATION_ENABLED),
    'power on for homing': (
        axis.power_on(Mode.HOMING), State.SWITCH_ON_DISABLED, State.OPERATION_ENABLED),
    'power down': (axis.POWER_DOWN, State.OPERATION_ENABLED, State.SWITCH_ON_DISABLED),
    'reset': (axis.RESET_FAULT, State.FAULT, State.SWITCH_ON_DISABLED),
}


def feedback_in(state: State, mode: int = CSP, **details) -> Feedback:
    return Feedback(STATUSWORDS[state][1], mode, **details)


def stepper(step: Step, deadline: float = 1.0) -> AxisStepper:
    watched = AxisStepper('q2')
    watched.begin(step, deadline)
    return watched


@pytest.mark.parametrize('plan', PLANS)
def test_each_plan_leads_a_drive_to_its_end(plan):
    plan_steps, state, end = PLANS[plan]
    for step in plan_steps:
        watched = stepper(step)
        state = TRANSITIONS.get((state, decode_command(step.controlword)), state)
        mode = CSP if step.mode is None else step.mode
        assert watched.advance(feedback_in(state, mode), now=0.0)
    assert state is end


@pytest.mark.parametrize(('step', 'on_its_way', 'there'), [
    (axis.power_on(CSP)[1], feedback_in(State.SWITCH_ON_DISABLED), State.READY_TO_SWITCH_ON),
    # one that shows no statusword before its first controlword
    (axis.POWER_OFF, Feedback(0x0000), State.SWITCH_ON_DISABLED)])
def test_drive_on_its_way_is_waited_for(step, on_its_way, there):
    watched = stepper(step)
    assert not watched.advance(on_its_way, now=0.5)
    assert watched.advance(feedback_in(there), now=0.9)


@pytest.mark.parametrize(('step', 'feedback', 'message'), [
    (axis.power_on(CSP)[1], feedback_in(State.SWITCH_ON_DISABLED),
     'q2 did not get ready.*switch on disabled'),
    (axis.power_on(CSP)[0], feedback_in(State.SWITCH_ON_DISABLED, Mode.HOMING),
     'in mode 6 instead of 8'),
    (axis.COME_TO_REST, feedback_in(State.OPERATION_ENABLED, at_rest=False), 'still moving')])
def test_drive_that_takes_too_long_is_named(step, feedback, message):
    watched = stepper(step)
    assert not watched.advance(feedback, now=0.9)
    with pytest.raises(DriveTimeoutError, match=message):
        watched.advance(feedback, now=1.1)


@pytest.mark.parametrize(('feedback', 'error', 'message'), [
    *((feedback_in(state, error='too late (8611h)'), DriveError, r'q2 .*too late \(8611h')
      for state in sorted(axis.FAULT_STATES, key=str)),
    (feedback_in(State.FAULT), DriveError, 'the drive sent no error code'),
    (Feedback(0x0025), DriveStateError, 'q2: statusword 0x0025')])
def test_drive_in_fault_or_no_state_is_named(feedback, error, message):
    with pytest.raises(error, match=message):
        stepper(axis.FOLLOW).advance(feedback, now=0.0)


def test_drive_that_falls_back_is_an_error():
    watched = stepper(axis.power_on(CSP)[1])
    assert watched.advance(feedback_in(State.READY_TO_SWITCH_ON), now=0.1)
    with pytest.raises(DriveStateError, match='q2 should get ready to switch on, but went to'):
        watched.advance(feedback_in(State.SWITCH_ON_DISABLED), now=0.2)
