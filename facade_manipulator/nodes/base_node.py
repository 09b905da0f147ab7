"""Base class of the nodes: methods that `run` calls, and the link from callbacks to their node."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
import traceback
from typing import Any

from rclpy.node import Node

from facade_manipulator.errors import InputError
from facade_manipulator.nodes.diagnostics import Diagnostics


class CallbackError(Exception):
    """
    An exception of a callback, chained to the original exception.

    `is_defect` is False in a service of rclpy, where a bad request raises an exception, such as
    that for a parameter of an unknown type.
    """

    def __init__(self, node: BaseNode, is_defect: bool) -> None:
        super().__init__(f'a callback of {node.get_name()} failed')
        self.node = node
        self.is_defect = is_defect


class BaseNode(Node):
    """
    Node that `run` starts, monitors and ends.

    Each callback raises a `CallbackError` with this node. A callback that calls another node
    passes the error of that node on.

    Attributes
    ----------
    own_name : str
        Name that topics, services and sections of parameter files contain.
    diagnostics : Diagnostics
        Counts the exceptions; each class sets it.
    wants_priority : bool
        Whether the process asks for real-time priority, because carriages depend on its time.

    """

    diagnostics: Diagnostics
    wants_priority = False
    _is_made = False  # callbacks created before belong to services of rclpy

    def __init__(self, name: str, **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self.own_name = name
        self._event_error: CallbackError | None = None
        self._is_made = True

    # --- called by `run`

    def next_step(self) -> str:
        """Return the operator's next step as the end of a message, or ``''``."""
        return ''

    @property
    def is_finalized(self) -> bool:
        """Return whether the process of this node should end."""
        return False

    def handle_exception(self, error: Exception) -> None:
        """Handle an exception in a callback of this node, which is a programming error."""

    def close(self) -> None:
        """Release all resources of the node; ROS still runs at this time."""

    def raise_event_error(self) -> None:
        """Raise the newest exception from a subscription event."""
        error = self._event_error
        self._event_error = None
        if error is not None:
            raise error

    def count_exception(self, error: Exception) -> None:
        """Log an exception with its traceback, and count it."""
        self.get_logger().error(''.join(traceback.format_exception(error)))
        self.diagnostics.reject(InputError('exception', repr(error)), is_logged=False)

    # --- callbacks

    def owned(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a callback so that its exception becomes a `CallbackError` with this node."""
        is_defect = self._is_made

        @wraps(callback)
        def call(*arguments: Any) -> Any:
            try:
                return callback(*arguments)
            except CallbackError:
                raise
            except Exception as error:
                raise CallbackError(self, is_defect) from error

        return call

    def _kept(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a callback so that `run` raises its error instead of rclpy (issue 1641)."""

        def call(*arguments: Any) -> None:
            try:
                callback(*arguments)
            except CallbackError as error:
                self._event_error = error

        return call

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Any, *args: Any, **options: Any
    ) -> Any:
        """Create a subscription whose callback and event callbacks belong to this node."""
        events = options.get('event_callbacks')
        if events is not None:
            for name, receive in vars(events).items():
                if callable(receive):
                    setattr(events, name, self._kept(self.owned(receive)))
        return super().create_subscription(
            msg_type, topic, self.owned(callback), *args, **options
        )

    def create_service(
        self, srv_type: Any, srv_name: str, callback: Any, **options: Any
    ) -> Any:
        """Create a service whose callback belongs to this node."""
        return super().create_service(
            srv_type, srv_name, self.owned(callback), **options
        )

    def create_timer(
        self, timer_period_sec: float, callback: Any, *args: Any, **options: Any
    ) -> Any:
        """Create a timer whose callback belongs to this node."""
        return super().create_timer(
            timer_period_sec, self.owned(callback), *args, **options
        )

    def add_on_set_parameters_callback(self, callback: Any) -> None:
        """Add a check of parameter changes that belongs to this node."""
        super().add_on_set_parameters_callback(self.owned(callback))

    def add_post_set_parameters_callback(self, callback: Any) -> None:
        """Add a function of this node that is called after parameters have changed."""
        super().add_post_set_parameters_callback(self.owned(callback))
