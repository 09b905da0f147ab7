"""Replies to requests, as futures."""

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any


def future_of(request: Callable[..., Any], name: str) -> Future:
    """Call a method that takes a name and a function; return a future of the reply."""
    answer = Future()

    def receive(reply: Any) -> None:
        if isinstance(reply, Exception):
            answer.set_exception(reply)
        else:
            answer.set_result(reply)

    request(name, receive)
    return answer
