"""
Workarounds that use private parts of rclpy 7.1.6, each with the issue that would replace it.

A later rclpy without one of these names makes a node exit at its start.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from lifecycle_msgs.msg import Transition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.parameter import Parameter

ROSError: type[Exception] = (
    rclpy_implementation.RCLError
)  #: rclpy has no public name for it


def given_parameters(node: Node) -> dict[str, Parameter]:
    """
    Return the parameters given to a node in files and on the command line, declared or not.

    ROS ignores a parameter that no node declares, and rclpy has no list of such parameters.
    """
    return node._parameter_overrides


def answer_later(
    service: Any, begin: Callable[[Any, Callable[[Any], None]], None]
) -> None:
    """
    Let a service answer after its callback has returned.

    `begin` receives the request and a function that sends the response. rclpy sends the returned
    value of the callback at once. It has no deferred response, which rclcpp has since its issue
    1707. The callback returns the request itself, so that rclpy passes the request and its header
    to the replaced `send_response`.
    """
    send_response = service.send_response
    service.callback = lambda request, _: request
    service.send_response = lambda request, header: begin(
        request, lambda response: send_response(response, header)
    )


# maximum number of messages taken from a topic at once; a flood must not block
MOST_WAITING = 100


def take_waiting(node: Node) -> None:
    """
    Call the callbacks of messages and requests that wait in the middleware.

    Rmw_fastrtps counts waiting messages before it listens for new messages; 2 of 2,000 messages
    were sent between these two steps. After an exception in a callback, the EventsExecutor has
    dropped its counter. In both cases the executor would take the waiting messages only with the
    next message.
    """
    for subscription in node.subscriptions:
        handle = subscription.handle
        for _ in range(MOST_WAITING):
            with handle:
                taken = handle.take_message(subscription.msg_type, subscription.raw)
            if taken is None:
                break
            subscription.callback(taken[0])
    for service in node.services:
        handle, kind = service.handle, cast(Any, service.srv_type)
        for _ in range(MOST_WAITING):
            with handle:
                request, header = handle.service_take_request(kind.Request)
            if request is None:
                break
            service.send_response(service.callback(request, kind.Response()), header)


class LifecycleMachine:
    """
    State machine of a lifecycle node, which the caller advances.

    rclpy runs a transition inside the callback of its service, so that the executor waits for the
    transition (rclcpp issue 2213). An impossible transition raises an exception (rclpy issue
    1209).
    """

    def __init__(
        self,
        node: LifecycleNode,
        change_state: Callable[[Any, Callable[[Any], None]], None],
    ) -> None:
        self._machine = node._state_machine
        answer_later(node._service_change_state, change_state)

    @property
    def label(self) -> str:
        """Return the label of the present state."""
        return self._machine.current_state[1]

    def possible(self, wanted: str | int) -> int | None:
        """Return the id of a requested transition, None if the transition is impossible now."""
        for number, label, *_ in self._machine.available_transitions:
            if (
                wanted in (number, label)
                and number <= Transition.TRANSITION_ACTIVE_SHUTDOWN
            ):
                return number
        return None

    def label_of(self, transition: int) -> str:
        """Return the label of a transition, even if the transition is impossible now."""
        labels = {number: label for number, label, *_ in self._machine.transition_graph}
        return labels.get(transition, f'transition {transition}')

    def begin(self, transition: int) -> None:
        """Enter the intermediate state of a transition."""
        self._machine.trigger_transition_by_id(transition, True)

    def finish(self, is_successful: bool) -> None:
        """Leave the intermediate state; after a failure, return to the previous state."""
        label = 'transition_success' if is_successful else 'transition_failure'
        self._machine.trigger_transition_by_label(label, True)
