"""Lifecycle node that answers other requests during transitions of several seconds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode
from std_srvs.srv import Trigger

from facade_manipulator.errors import attributed, ManipulatorError
from facade_manipulator.nodes.base_node import BaseNode
from facade_manipulator.nodes.conversions import steady_timer
from facade_manipulator.nodes.workarounds import answer_later, LifecycleMachine
from facade_manipulator.topics import Service

UNCONFIGURED_LABEL = 'unconfigured'  # label of a state
#: takes the result of a request, or the ManipulatorError with which it failed
OnReply = Callable[[Any], None]


class ManagedNode(BaseNode, LifecycleNode):
    """
    Lifecycle node that executes transitions as requests to another process.

    The node must receive the operator's stop while the drives boot. The node is in the transition
    state of the standard, such as *configuring*, until the other process has replied. An error
    leads back to the previous state.

    Attributes
    ----------
    transitions : mapping
        Functions that start a transition, by its label, and take the function that receives the
        reply. A ManipulatorError that they raise is the reply.
    last_failure : str
        Message of the last request if it failed, else ``''``.

    """

    # s, between two checks whether a missing interface has appeared
    INTERFACE_CHECK_PERIOD = 0.2

    def __init__(self, name: str, **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self.transitions: Mapping[str, Callable[[OnReply], None]] = {}
        self.last_failure = ''
        self._machine = LifecycleMachine(self, self.owned(self._change_state))

    @property
    def state_label(self) -> str:
        """Return the label of the present state."""
        return self._machine.label

    @property
    def is_finalized(self) -> bool:
        """Return whether the shutdown transition has ended."""
        return self.state_label == 'finalized'

    def report(self, is_successful: bool, message: str) -> None:
        """Log the result of a request, because transition responses contain no text."""
        if is_successful:
            self.get_logger().info(message)
        elif message != self.last_failure:  # a repeated request must not fill the disk
            self.get_logger().error(message)
        self.last_failure = '' if is_successful else message

    def offer(
        self,
        service: Service,
        start: Callable[[OnReply], None],
        answer: Callable[[Any], Any] | None = None,
    ) -> None:
        """
        Offer a service that starts a request, like the functions in `transitions`.

        `answer` converts the reply to a response, if its type is not that of Trigger.
        """
        answer = answer or self._trigger_response

        def begin(_: Any, respond: Callable[[Any], None]) -> None:
            self._start(start, lambda reply: respond(answer(reply)))

        made = self.create_service(*service, lambda _, response: response)
        answer_later(made, self.owned(begin))

    def fall_back(self, to_unconfigured: bool) -> None:
        """Follow the drives out of a state: to inactive, or to unconfigured."""
        steps = {'active': Transition.TRANSITION_DEACTIVATE}
        if to_unconfigured:
            steps['inactive'] = Transition.TRANSITION_CLEANUP
        for label, transition in steps.items():
            if self.state_label == label:
                self._machine.begin(transition)
                self._machine.finish(is_successful=True)

    def configure_soon(self, missing: Callable[[], str]) -> None:
        """Configure automatically as soon as `missing` returns ``''`` instead of a reason."""

        def look() -> None:
            if self.state_label == UNCONFIGURED_LABEL and (lacking := missing()):
                self.report(False, f'configure waits: {lacking}')
                return
            timer.cancel()
            if self.state_label == UNCONFIGURED_LABEL:
                self._begin(Transition.TRANSITION_CONFIGURE, lambda _: None)

        timer = steady_timer(self, self.INTERFACE_CHECK_PERIOD, look)

    def _start(self, start: Callable[[OnReply], None], on_reply: OnReply) -> None:
        """Start a request; reply with a ManipulatorError that it raises."""
        try:
            start(on_reply)
        except ManipulatorError as error:
            on_reply(error)

    def _trigger_response(self, reply: Any) -> Trigger.Response:
        """Log the driver's reply, and return it as a service response."""
        succeeded = not isinstance(reply, ManipulatorError)
        message = str(reply)
        self.report(succeeded, message)
        return Trigger.Response(success=succeeded, message=message)

    def _change_state(
        self,
        request: ChangeState.Request,
        respond: Callable[[ChangeState.Response], None],
    ) -> None:
        """Start a transition by label or id, or reject it if the state does not permit it."""
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
        """Start a transition, and respond after its end."""

        def finish(reply: Any) -> None:
            succeeded = not isinstance(reply, ManipulatorError)
            self._machine.finish(succeeded)
            message = str(reply)
            if not succeeded:
                message = attributed(label, 'failed', message)
            self.report(succeeded, message)
            respond(ChangeState.Response(success=succeeded))

        label = self._machine.label_of(transition)
        self._machine.begin(transition)
        self._start(self.transitions[label], finish)
