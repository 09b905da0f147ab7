"""Base class of the nodes: the methods that `run` calls, and the owner of each callback."""

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
    Exception of a callback, raised from the original exception.

    `is_defect` is False in a service of rclpy, where a bad request raises an exception, such as
    that for a parameter of an unknown type.
    """

    def __init__(self, node: BaseNode, is_defect: bool) -> None:
        super().__init__(f'a callback of {node.get_name()} failed')
        self.node = node
        self.is_defect = is_defect


class BaseNode(Node):
    """
    Node that `run` starts, watches and ends.

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
    _is_made = False  # the callbacks before that are services of rclpy

    def __init__(self, name: str, **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self.own_name = name
        self._event_error: CallbackError | None = None
        self._is_made = True

    # --- called by `run`

    def next_step(self) -> str:
        """Return the next step of the operator as the end of a message, ``''`` for none."""
        return ''

    @property
    def is_finalized(self) -> bool:
        """Return whether the node wants its process to end."""
        return False

    def handle_exception(self, error: Exception) -> None:
        """React to an exception in a callback of this node, which is a defect."""

    def close(self) -> None:
        """Release what the node owns; ROS still runs."""

    def raise_event_error(self) -> None:
        """Raise the newest exception of an event of a subscription."""
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
        """Return a callback that raises a `CallbackError` with this node."""
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
        """Return a callback whose error `run` raises; here it would crash (rclpy issue 1641)."""

        def call(*arguments: Any) -> None:
            try:
                callback(*arguments)
            except CallbackError as error:
                self._event_error = error

        return call

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Any, *args: Any, **options: Any
    ) -> Any:
        """Create a subscription; its callback and those of its events belong to this node."""
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
        """Add a check of changed parameters that belongs to this node."""
        super().add_on_set_parameters_callback(self.owned(callback))

    def add_post_set_parameters_callback(self, callback: Any) -> None:
        """Add a user of changed parameters that belongs to this node."""
        super().add_post_set_parameters_callback(self.owned(callback))
