"""
A managed (lifecycle) node whose transitions take their time while the node keeps answering.

rclpy's lifecycle node runs a transition inside its service's callback. A drive takes seconds to
boot and the operator's stop must be received meanwhile, so here a transition is a job: the node is
in the standard's transition state (configuring, activating, …) until the job is done. For that
`ManagedNode` replaces the callback of the private `_service_change_state` and steps the private
`_state_machine`.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

from facade_manipulator.ros.clocks import steady_timer
from facade_manipulator.ros.deferred import Deferred, DeferredReplies, require_of_rclpy
from facade_manipulator.ros.diagnostics import RepeatedLog

SUCCESS = TransitionCallbackReturn.SUCCESS
FAILURE = TransitionCallbackReturn.FAILURE
NAMES = {
    Transition.TRANSITION_CONFIGURE: 'configure',
    Transition.TRANSITION_CLEANUP: 'cleanup',
    Transition.TRANSITION_ACTIVATE: 'activate',
    Transition.TRANSITION_DEACTIVATE: 'deactivate',
}


class ManagedNode(LifecycleNode):
    """Lifecycle node with one job per transition; see `transition_jobs`."""

    def __init__(self, name: str, **kwargs) -> None:
        super().__init__(name, **kwargs)
        require_of_rclpy(self, '_service_change_state', '_state_machine')
        self.replies = DeferredReplies(self)
        self._failures = RepeatedLog()
        self.replies.attach(self._service_change_state)
        self._service_change_state.callback = self._on_change_state

    def transition_jobs(self) -> dict[int, Callable[[], Future]]:
        """
        Return what starts each transition, by ``State.TRANSITION_STATE_…`` id.

        A job that raises makes its transition fail: the node returns to the state it came from.
        """
        return {}

    def following_step(self) -> str:
        """Return what follows on what is wrong in the message of a rejection: the next step."""
        return ''

    @property
    def state_label(self) -> str:
        """Label of the present lifecycle state."""
        return self._state_machine.current_state[1]

    def report(self, success: bool, message: str) -> None:
        """Log how a request ended, before its response: that of a transition has no text."""
        if success:
            self.get_logger().info(message)
        else:
            self._failures.add(self.get_logger().error, message)

    def fall_back(self, to_unconfigured: bool = False) -> None:
        """Go from active to inactive, or further: what the state stands for has already ended."""
        paths = {State.PRIMARY_STATE_ACTIVE: Transition.TRANSITION_DEACTIVATE}
        if to_unconfigured:
            paths[State.PRIMARY_STATE_INACTIVE] = Transition.TRANSITION_CLEANUP
        while (transition := paths.pop(self._state_machine.current_state[0], None)) is not None:
            self._state_machine.trigger_transition_by_id(transition, True)
            self._finish(SUCCESS)

    def _on_change_state(self, request: ChangeState.Request, response: ChangeState.Response):
        transition = self._requested(request)
        if transition is None:
            what = request.transition.label or NAMES.get(
                request.transition.id, f'transition {request.transition.id}')
            self.report(
                False, f'{what} is not possible, the node is {self.state_label}'
                f'{self.following_step()}')
            response.success = False
            return response
        return Deferred(self._begin(transition), self._complete)

    def configure_soon(self) -> None:
        """Configure by itself, without a request, once the node is spun."""
        def configure() -> None:
            timer.cancel()
            if self._state_machine.current_state[0] == State.PRIMARY_STATE_UNCONFIGURED:
                self.replies.when_done(
                    self._begin(Transition.TRANSITION_CONFIGURE), self._complete)

        timer = steady_timer(self, 0.0, configure)

    def _begin(self, transition: int) -> Future:
        self._state_machine.trigger_transition_by_id(transition, True)
        return self.transition_jobs()[self._state_machine.current_state[0]]()

    def _requested(self, request: ChangeState.Request) -> int | None:
        """Return the id of the requested transition, None if it is not available now."""
        wanted = request.transition.label or request.transition.id
        for number, label, _, _, goal, _ in self._state_machine.available_transitions:
            if wanted in (number, label) and goal in self.transition_jobs():
                return number
        return None

    def _complete(self, job: Future) -> ChangeState.Response:
        error = job.exception()
        what = self.state_label
        self._finish(SUCCESS if error is None else FAILURE)
        if error is not None:
            self.report(False, f'{what} failed: {error}')
        else:
            self.report(True, str(job.result()))
        return ChangeState.Response(success=error is None)

    def _finish(self, outcome: TransitionCallbackReturn) -> None:
        self._state_machine.trigger_transition_by_label(outcome.to_label(), True)
