"""Managed node whose transitions take seconds while it answers other requests."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode
from std_srvs.srv import Trigger

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.nodes.conversions import steady_timer
from facade_manipulator.nodes.workarounds import answer_later, LifecycleMachine
from facade_manipulator.topics import Service

UNCONFIGURED = 'unconfigured'  # label of a state
LOOK_PERIOD = 0.2  # s, between two checks whether a missing interface has appeared
Job = Future[Any]


class ManagedNode(LifecycleNode):
    """
    Lifecycle node whose transitions are jobs of other threads or processes.

    The node must receive the operator's stop while the drives boot. It is in the transition state
    of the standard, such as *configuring*, until the job is done. A job that raises an exception
    leads back to the previous state. The node calls `finish_jobs` periodically.

    Attributes
    ----------
    transitions : mapping
        Functions that start the job of a transition, by its label.
    last_failure : str
        Message of the last request if it failed, else ``''``.

    """

    def __init__(self, name: str, **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self.transitions: Mapping[str, Callable[[], Job]] = {}
        self.last_failure = ''
        self._jobs: list[tuple[Job, Callable[[Job], None]]] = []
        self._machine = LifecycleMachine(self, self._change_state)

    @property
    def state_label(self) -> str:
        """Return the label of the present state."""
        return self._machine.label

    def next_step(self) -> str:
        """Return the next step of the operator as the end of a message."""
        return ''

    def report(self, is_successful: bool, message: str) -> None:
        """Log the result of a request, because the response of a transition has no text."""
        if is_successful:
            self.get_logger().info(message)
        elif message != self.last_failure:  # a repeated request fills no disk
            self.get_logger().error(message)
        self.last_failure = '' if is_successful else message

    def finish_jobs(self) -> None:
        """Answer the requests of completed jobs; an exception leaves the others pending."""
        for entry in [entry for entry in self._jobs if entry[0].done()]:
            self._jobs.remove(entry)
            job, finish = entry
            finish(job)

    def offer(
        self,
        service: Service,
        start: Callable[[], Job],
        answer: Callable[[Job], Any] | None = None,
    ) -> None:
        """Offer a service that starts a job; `answer` makes a response other than of Trigger."""
        answer = answer or self._trigger_response
        made = self.create_service(*service, lambda _, response: response)
        answer_later(
            made, lambda _, respond: self._run(start, lambda job: respond(answer(job)))
        )

    def fall_back(self, to_unconfigured: bool) -> None:
        """Leave a state that the drives have already left: to inactive, or to unconfigured."""
        steps = {'active': Transition.TRANSITION_DEACTIVATE}
        if to_unconfigured:
            steps['inactive'] = Transition.TRANSITION_CLEANUP
        for label, transition in steps.items():
            if self.state_label == label:
                self._machine.begin(transition)
                self._machine.finish(is_successful=True)

    def configure_soon(self, missing: Callable[[], str] = str) -> None:
        """Configure without a request as soon as `missing` returns ``''`` instead of a reason."""

        def look() -> None:
            if self.state_label == UNCONFIGURED and (lacking := missing()):
                self.report(False, f'configure waits: {lacking}')
                return
            timer.cancel()
            if self.state_label == UNCONFIGURED:
                self._begin(Transition.TRANSITION_CONFIGURE, lambda _: None)

        timer = steady_timer(self, LOOK_PERIOD, look)

    def _run(self, start: Callable[[], Job], finish: Callable[[Job], None]) -> None:
        """Start a job; `finish` receives the job when it is done."""
        try:
            job = start()
        except ManipulatorError as error:
            job = Future()
            job.set_exception(error)
        self._jobs.append((job, finish))

    def _trigger_response(self, job: Job) -> Trigger.Response:
        error = job.exception()
        message = str(error or job.result())
        self.report(error is None, message)
        return Trigger.Response(success=error is None, message=message)

    def _change_state(
        self,
        request: ChangeState.Request,
        respond: Callable[[ChangeState.Response], None],
    ) -> None:
        wanted = request.transition
        transition = self._machine.possible(wanted.label or wanted.id)
        if transition is None:
            self.report(
                False,
                f'{wanted.label or self._machine.label_of(wanted.id)} rejected: '
                f'the node is {self.state_label}{self.next_step()}',
            )
            respond(ChangeState.Response(success=False))
        else:
            self._begin(transition, respond)

    def _begin(
        self, transition: int, respond: Callable[[ChangeState.Response], None]
    ) -> None:
        def finish(job: Job) -> None:
            error = job.exception()
            self._machine.finish(is_successful=error is None)
            self.report(
                error is None,
                f'{label} failed: {error}' if error else str(job.result()),
            )
            respond(ChangeState.Response(success=error is None))

        label = self._machine.label_of(transition)
        self._machine.begin(transition)
        self._run(self.transitions[label], finish)
