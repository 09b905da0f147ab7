"""A managed node whose transitions take seconds while it answers other requests."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from functools import partial
from typing import Any

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode
from std_srvs.srv import Trigger

from facade_manipulator.nodes.clock import steady_timer
from facade_manipulator.nodes.services import Jobs, offer_later
from facade_manipulator.nodes.workarounds import LifecycleMachine
from facade_manipulator.topics import Service

LOOK_PERIOD = 0.2  # s, between two checks whether a missing interface has appeared
Transitions = Mapping[str, Callable[[], Future[Any]]]


class ManagedNode(LifecycleNode):
    """
    A lifecycle node whose transitions are jobs.

    The operator's stop must be received while the drives boot. The node is in the transition state
    of the standard, such as *configuring*, until the job is done. A job that raises an exception
    leads back to the previous state.

    Attributes
    ----------
    transitions : mapping
        Functions that start the job of a transition, by its label.
    jobs : Jobs
        The node calls `finish_done` periodically.
    last_failure : str
        Message of the last request if it failed, else ``''``.

    """

    def __init__(self, name: str, **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self.transitions: Transitions = {}
        self.jobs = Jobs()
        self.last_failure = ''
        self._machine = LifecycleMachine(self, self._change_state)

    @property
    def state_label(self) -> str:
        """Return the label of the present state."""
        return self._machine.label

    @property
    def is_finalized(self) -> bool:
        """Return whether the node was shut down, after which its process ends."""
        return self._machine.is_finalized

    def next_step(self) -> str:
        """Return the next step of the operator, as the end of a message."""
        return ''

    def report(self, is_successful: bool, message: str) -> None:
        """Log the result of a request before its response: that of a transition has no text."""
        if is_successful:
            self.get_logger().info(message)
        elif message != self.last_failure:  # a repeated request fills no disk
            self.get_logger().error(message)
        self.last_failure = '' if is_successful else message

    def offer_job(self, service: Service, start: Callable[[], Future[Any]]) -> None:
        """Offer a service of type Trigger that starts a job and answers with its result."""
        def begin(_: Trigger.Request, respond: Callable[[Trigger.Response], None]) -> None:
            self.jobs.add(start(), partial(finish, respond))

        def finish(respond: Callable[[Trigger.Response], None], job: Future[Any]) -> None:
            error = job.exception()
            message = str(error or job.result())
            self.report(error is None, message)
            respond(Trigger.Response(success=error is None, message=message))

        offer_later(self, service, begin)

    def fall_back(self, to_unconfigured: bool) -> None:
        """Leave a state that the drives have already left: to inactive, or to unconfigured."""
        if self._machine.state == State.PRIMARY_STATE_ACTIVE:
            self._machine.begin(Transition.TRANSITION_DEACTIVATE)
            self._machine.finish(is_successful=True)
        if to_unconfigured and self._machine.state == State.PRIMARY_STATE_INACTIVE:
            self._machine.begin(Transition.TRANSITION_CLEANUP)
            self._machine.finish(is_successful=True)

    def configure_soon(self, missing: Callable[[], str] = str) -> None:
        """Configure without a request, as soon as `missing` returns ``''``, the lacking part."""
        reported = ''

        def look() -> None:
            nonlocal reported
            is_unconfigured = self._machine.state == State.PRIMARY_STATE_UNCONFIGURED
            if is_unconfigured and (lacking := missing()):
                if lacking != reported:
                    self.report(False, f'configure waits: {lacking}')
                reported = lacking
                return
            timer.cancel()
            if is_unconfigured:
                self._begin(Transition.TRANSITION_CONFIGURE, lambda _: None)

        timer = steady_timer(self, LOOK_PERIOD, look)

    def _change_state(
        self, request: ChangeState.Request, respond: Callable[[ChangeState.Response], None]
    ) -> None:
        wanted = request.transition
        transition = self._machine.possible(wanted.label or wanted.id)
        if transition is None:
            self.report(
                False, f'{wanted.label or self._machine.label_of(wanted.id)} is not possible, '
                f'the node is {self.state_label}{self.next_step()}')
            respond(ChangeState.Response(success=False))
        else:
            self._begin(transition, respond)

    def _begin(
        self, transition: int, respond: Callable[[ChangeState.Response], None]
    ) -> None:
        def finish(job: Future[Any]) -> None:
            error, label = job.exception(), self.state_label
            self._machine.finish(is_successful=error is None)
            self.report(error is None, f'{label} failed: {error}' if error else str(job.result()))
            respond(ChangeState.Response(success=error is None))

        self._machine.begin(transition)
        self.jobs.add(self.transitions[self._machine.label_of(transition)](), finish)
