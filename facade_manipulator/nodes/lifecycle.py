"""A managed node whose transitions take seconds while it answers other requests."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from functools import partial
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from std_srvs.srv import Trigger

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.nodes.clock import steady_timer
from facade_manipulator.nodes.workarounds import answer_later, LifecycleMachine
from facade_manipulator.topics import Service

UNCONFIGURED = 'unconfigured'  # label of a state
LOOK_PERIOD = 0.2  # s, between two checks whether a missing interface has appeared
Transitions = Mapping[str, Callable[[], Future[Any]]]


def offer_later(
    node: Node, service: Service, begin: Callable[[Any, Callable[[Any], None]], None]
) -> None:
    """Offer a service; `begin` receives a request and a function that sends its response."""
    answer_later(node.create_service(*service, lambda _, response: response), begin)


class Jobs:
    """Jobs of other threads or processes that are finished in the executor of a node."""

    def __init__(self) -> None:
        self._pending: list[tuple[Future[Any], Callable[[Future[Any]], None]]] = []

    def add(
        self, start: Callable[[], Future[Any]], finish: Callable[[Future[Any]], None]
    ) -> None:
        """Start a job; `finish` receives it once it is done and `finish_done` is called."""
        try:
            job = start()
        except ManipulatorError as error:
            job = Future()
            job.set_exception(error)
        self._pending.append((job, finish))

    def finish_done(self) -> None:
        """Finish all jobs that are done; an exception leaves the others pending."""
        for entry in [one for one in self._pending if one[0].done()]:
            self._pending.remove(entry)
            job, finish = entry
            finish(job)


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
            self.jobs.add(start, partial(finish, respond))

        def finish(respond: Callable[[Trigger.Response], None], job: Future[Any]) -> None:
            error = job.exception()
            message = str(error or job.result())
            self.report(error is None, message)
            respond(Trigger.Response(success=error is None, message=message))

        offer_later(self, service, begin)

    def fall_back(self, to_unconfigured: bool) -> None:
        """Leave a state that the drives have already left: to inactive, or to unconfigured."""
        if self.state_label == 'active':
            self._machine.begin(Transition.TRANSITION_DEACTIVATE)
            self._machine.finish(is_successful=True)
        if to_unconfigured and self.state_label == 'inactive':
            self._machine.begin(Transition.TRANSITION_CLEANUP)
            self._machine.finish(is_successful=True)

    def configure_soon(self, missing: Callable[[], str] = str) -> None:
        """Configure without a request, as soon as `missing` returns ``''``, the lacking part."""
        def look() -> None:
            is_unconfigured = self.state_label == UNCONFIGURED
            if is_unconfigured and (lacking := missing()):
                message = f'configure waits: {lacking}'
                if message != self.last_failure:
                    self.report(False, message)
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
        self.jobs.add(self.transitions[self._machine.label_of(transition)], finish)
