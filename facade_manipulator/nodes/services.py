"""Services whose answer is a message, at once or after the callback has returned."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from rclpy.node import Node
from std_srvs.srv import Trigger

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.nodes.workarounds import answer_later
from facade_manipulator.topics import Service


def offer_trigger(node: Node, service: Service, act: Callable[[], str]) -> None:
    """Offer a service of type Trigger that answers with the returned message or with the error."""
    def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.message, response.success = act(), True
        except ManipulatorError as error:
            response.message = str(error)
        return response

    node.create_service(*service, answer)


def offer_later(
    node: Node, service: Service, begin: Callable[[Any, Callable[[Any], None]], None]
) -> None:
    """Offer a service; `begin` receives a request and a function that sends its response."""
    answer_later(node.create_service(*service, lambda _, response: response), begin)


class Jobs:
    """Jobs of other threads or processes that are finished in the executor of a node."""

    def __init__(self) -> None:
        self._pending: list[tuple[Future[Any], Callable[[Future[Any]], None]]] = []

    def add(self, job: Future[Any], finish: Callable[[Future[Any]], None]) -> None:
        """Let `finish` receive the job once it is done and `finish_done` is called."""
        self._pending.append((job, finish))

    def finish_done(self) -> None:
        """Finish all jobs that are done; an exception leaves the others pending."""
        for entry in [one for one in self._pending if one[0].done()]:
            self._pending.remove(entry)
            job, finish = entry
            finish(job)
