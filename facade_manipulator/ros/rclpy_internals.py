"""
What the nodes use of rclpy beyond its public interface: in this file alone.

Tried on rclpy 7.1.6. What another version does not have ends a node when it starts, by name.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from lifecycle_msgs.msg import State
from rcl_interfaces.msg import Parameter as ParameterMessage
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.service import Service

from facade_manipulator.errors import ManipulatorError

ROSError: type[Exception] = rclpy_implementation.RCLError  #: which rclpy has no public name for
TYPES = {kind.value for kind in Parameter.Type}
MOST_WAITING = 100  # messages of one topic or service: in a flood there would be no end
_from_message = Parameter.from_parameter_msg


def require_of_rclpy(owner: object, *names: str) -> None:
    """
    Check that an object of rclpy has what is used beyond its public interface.

    Raises
    ------
    ManipulatorError
        Naming what is missing: the node does not start.

    """
    if missing := [name for name in names if not hasattr(owner, name)]:
        raise ManipulatorError(
            f'the {type(owner).__name__} of this rclpy has no {", ".join(missing)}: install '
            'rclpy 7.1.6, on which this version was tried')


def _from_any_message(message: ParameterMessage) -> Parameter:
    """Return a parameter without a value for a type that there is not."""
    return _from_message(message) if message.value.type in TYPES else Parameter(message.name)


# of such a type rclpy makes an error in its own service that ends the node
setattr(Parameter, 'from_parameter_msg', staticmethod(_from_any_message))  # noqa: B010


def given_parameters(node: Node) -> dict[str, Parameter]:
    """Return the parameters that files and command line give a node, declared or not, by name."""
    require_of_rclpy(node, '_parameter_overrides')
    return node._parameter_overrides


def subscription_without_executor(
    node: Node, kind: type, topic: str, quality: QoSProfile
) -> Any:
    """Return a subscription whose messages wait until they are taken."""
    require_of_rclpy(rclpy_implementation, 'Subscription')
    with node.handle:
        made = rclpy_implementation.Subscription(
            node.handle, kind, topic, quality.get_c_qos_profile())
    require_of_rclpy(made, 'take_message')
    return made


def take_what_waits(node: Node) -> None:
    """
    Hand on what came before an EventsExecutor listened.

    rmw_fastrtps counts what has come and listens a moment later: nobody hears of what comes
    between the two, until more comes to the same subscription or service.
    """
    for subscription in node.subscriptions:
        handle = subscription.handle
        require_of_rclpy(handle, 'take_message')
        for _ in range(MOST_WAITING):
            with handle:
                taken = handle.take_message(subscription.msg_type, subscription.raw)
            if taken is None:
                break
            subscription.callback(taken[0])
    for service in node.services:
        handle, kind = service.handle, cast(Any, service.srv_type)
        require_of_rclpy(handle, 'service_take_request')
        for _ in range(MOST_WAITING):
            with handle:
                request, header = handle.service_take_request(kind.Request)
            if request is None:
                break
            service.send_response(service.callback(request, kind.Response()), header)


def send_responses_by(service: Service, send: Callable[..., None]) -> Callable[..., None]:
    """Let responses of a service go through a function; return what sends them."""
    require_of_rclpy(service, 'send_response')
    send_response = service.send_response
    service.send_response = send  # type: ignore[method-assign]  # that is the wrapping
    return send_response


class LifecycleMachine:
    """
    The state machine of a lifecycle node, stepped from outside.

    rclpy runs a transition inside its service's callback; here it begins and ends when the node
    says so.
    """

    def __init__(self, node: LifecycleNode) -> None:
        require_of_rclpy(node, '_service_change_state', '_state_machine')
        self.service: Service = node._service_change_state
        self._machine = node._state_machine

    @property
    def state(self) -> int:
        """Return the present state, a ``State.PRIMARY_STATE_…`` or ``TRANSITION_STATE_…``."""
        return self._machine.current_state[0]

    @property
    def label(self) -> str:
        """Label of the present state."""
        return self._machine.current_state[1]

    @property
    def is_over(self) -> bool:
        """Whether the node was shut down."""
        return self.state == State.PRIMARY_STATE_FINALIZED

    def possible(self, wanted: str | int) -> tuple[int, int] | None:
        """Return id and next state of a transition that is possible now, by label or id."""
        for number, label, _, _, goal, _ in self._machine.available_transitions:
            if wanted in (number, label):
                return number, goal
        return None

    def name_of(self, transition: int) -> str:
        """Return a transition's label, possible now or not."""
        names = {number: label for number, label, *_ in self._machine.transition_graph}
        return names.get(transition, f'transition {transition}')

    def begin(self, transition: int) -> int:
        """Go to the transition's own state and return it."""
        self._machine.trigger_transition_by_id(transition, True)
        return self.state

    def finish(self, outcome: TransitionCallbackReturn) -> None:
        """Leave the transition's own state."""
        self._machine.trigger_transition_by_label(outcome.to_label(), True)
