"""Requests: services that answer at once or later, lifecycle transitions as jobs."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, NamedTuple

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.service import Service as Offer
from std_srvs.srv import Trigger

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.interfaces import Service
from facade_manipulator.ros.clocks import steady_timer
from facade_manipulator.ros.diagnostics import RepeatedLog
from facade_manipulator.ros.interfaces import service
from facade_manipulator.ros.rclpy_internals import LifecycleMachine, send_responses_by

SUCCESS = TransitionCallbackReturn.SUCCESS
FAILURE = TransitionCallbackReturn.FAILURE
LOOKING_PERIOD = 0.2  # s, between looks whether what is missing has come


def offer_trigger(node: Node, offered: Service, act: Callable[[], str]) -> None:
    """Offer a service that does something at once, and answers with its message or its error."""
    def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.success, response.message = True, act()
        except ManipulatorError as error:
            response.success, response.message = False, str(error)
        return response

    service(node, offered, answer)


class Deferred(NamedTuple):
    """An answer that follows when a job is done."""

    job: Future[Any]  #: completed in any thread
    #: takes the completed job, returns the service's response; runs in the executor
    respond: Callable[[Future[Any]], Any]


def may_defer(node: Node, service: Offer) -> None:
    """
    Let a service's callback return a `Deferred` in place of a response: the executor never waits.

    rclpy sends what a service's callback returns at once. Waiting there would stop every other
    callback of the node, among them the one that receives the operator's stop; a coroutine is
    polled without pause while it waits. Here the answer is sent when the job is done: the
    service's own `send_response` is wrapped.
    """
    def send(response: Any, header: Any) -> None:
        if isinstance(response, Deferred):
            _when_done(node, response.job, lambda job: send_response(
                response.respond(job), header))
        else:
            send_response(response, header)

    send_response = send_responses_by(service, send)


def _when_done(node: Node, job: Future[Any], action: Callable[[Future[Any]], Any]) -> None:
    """Do something with a job that any thread completes, in the node's executor."""
    def in_executor(job: Future[Any]) -> None:
        executor = node.executor
        if executor is not None:  # else the node has ended, and its clients know
            executor.create_task(action, job)  # a task wakes any kind of executor

    job.add_done_callback(in_executor)


class ManagedNode(LifecycleNode):
    """
    A lifecycle node whose transitions take their time while the node keeps answering.

    rclpy's lifecycle node runs a transition inside its service's callback. A drive takes seconds
    to boot and the operator's stop must be received meanwhile, so here a transition is a job (see
    `transition_jobs`): the node is in the standard's transition state (configuring, activating, …)
    until the job is done.
    """

    def __init__(self, name: str, **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self._lifecycle = LifecycleMachine(self)
        self._failures = RepeatedLog()
        may_defer(self, self._lifecycle.service)
        self._lifecycle.service.callback = self._on_change_state

    def transition_jobs(self) -> dict[int, Callable[[], Future[Any]]]:
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
        return self._lifecycle.label

    @property
    def is_over(self) -> bool:
        """Whether the node was shut down, from which there is no way back: its process ends."""
        return self._lifecycle.is_over

    def report(self, success: bool, message: str) -> None:
        """Log how a request ended, before its response: that of a transition has no text."""
        if success:
            self.get_logger().info(message)
        elif self._failures.is_due(message):
            self.get_logger().error(message)

    def fall_back(self, to_unconfigured: bool = False) -> None:
        """Go from active to inactive, or further: what the state stands for has already ended."""
        paths = {State.PRIMARY_STATE_ACTIVE: Transition.TRANSITION_DEACTIVATE}
        if to_unconfigured:
            paths[State.PRIMARY_STATE_INACTIVE] = Transition.TRANSITION_CLEANUP
        while (transition := paths.pop(self._lifecycle.state, None)) is not None:
            self._lifecycle.begin(transition)
            self._lifecycle.finish(SUCCESS)

    def _on_change_state(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> Any:
        transition = self._requested(request)
        if transition is None:
            what = request.transition.label or self._lifecycle.name_of(request.transition.id)
            self.report(
                False, f'{what} is not possible, the node is {self.state_label}'
                f'{self.following_step()}')
            response.success = False
            return response
        return Deferred(self._begin(transition), self._complete)

    def configure_soon(self, missing: Callable[[], str] = str) -> None:
        """
        Configure by itself, without a request, once the node is spun.

        Parameters
        ----------
        missing : callable
            Returns what it waits for, ``''`` for nothing.

        """
        said = ''

        def configure() -> None:
            nonlocal said
            is_unconfigured = self._lifecycle.state == State.PRIMARY_STATE_UNCONFIGURED
            if is_unconfigured and (lacking := missing()):
                if lacking != said:
                    self.report(False, f'configure waits: {lacking}')
                said = lacking
                return
            timer.cancel()
            if is_unconfigured:
                _when_done(
                    self, self._begin(Transition.TRANSITION_CONFIGURE), self._complete)

        timer = steady_timer(self, LOOKING_PERIOD, configure)

    def _begin(self, transition: int) -> Future[Any]:
        return self.transition_jobs()[self._lifecycle.begin(transition)]()

    def _requested(self, request: ChangeState.Request) -> int | None:
        """Return the id of the requested transition, None if it is not available now."""
        found = self._lifecycle.possible(request.transition.label or request.transition.id)
        return found[0] if found and found[1] in self.transition_jobs() else None

    def _complete(self, job: Future[Any]) -> ChangeState.Response:
        error = job.exception()
        what = self.state_label
        self._lifecycle.finish(SUCCESS if error is None else FAILURE)
        if error is not None:
            self.report(False, f'{what} failed: {error}')
        else:
            self.report(True, str(job.result()))
        return ChangeState.Response(success=error is None)
