"""
Services whose answer takes longer than a callback may: the executor never waits.

rclpy sends what a service's callback returns at once. Waiting there would stop every other
callback of the node, among them the one that receives the operator's stop; a coroutine is polled
without pause while it waits. Here the callback returns a `Deferred` and the answer is sent when
its job is done: the service's own `send_response` is wrapped.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from rclpy.node import Node
from rclpy.service import Service

from facade_manipulator.errors import ManipulatorError


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


class Deferred:
    """
    An answer that follows when a job is done.

    Parameters
    ----------
    job : concurrent.futures.Future
        Completed in any thread.
    respond : callable
        Takes the completed job, returns the service's response; runs in the executor.

    """

    def __init__(self, job: Future, respond: Callable[[Future], Any]) -> None:
        self.job = job
        self.respond = respond


class DeferredReplies:
    """Let services of one node answer later."""

    def __init__(self, node: Node) -> None:
        self._node = node

    def attach(self, service: Service) -> None:
        """Let the service's callback return a `Deferred` in place of a response."""
        require_of_rclpy(service, 'send_response')
        send_response = service.send_response

        def send(response, header):
            if isinstance(response, Deferred):
                self.when_done(response.job, lambda job: send_response(
                    response.respond(job), header))
            else:
                send_response(response, header)

        service.send_response = send

    def when_done(self, job: Future, action: Callable[[Future], Any]) -> None:
        """Do something with a completed job in the executor."""
        job.add_done_callback(lambda job: self._in_executor(lambda: action(job)))

    def _in_executor(self, answer: Callable[[], None]) -> None:
        """Run in the node's executor, from any thread: a task wakes any kind of executor."""
        executor = self._node.executor
        if executor is not None:  # else the node has ended, and its clients know
            executor.create_task(answer)
