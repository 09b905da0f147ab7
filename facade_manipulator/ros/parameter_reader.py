"""The parameters of another node, as they are now."""

from __future__ import annotations

import json
from typing import Any

from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future


class ParameterReader:
    """
    Read all parameters of a node without waiting for it.

    Parameters
    ----------
    node : rclpy.node.Node
        Who asks.
    name : str
        Who is asked.

    Attributes
    ----------
    values : dict
        Parameters by name; empty until the node has answered.

    """

    def __init__(self, node: Node, name: str) -> None:
        self.values: dict[str, Any] = {}
        # not rclpy's AsyncParameterClient: its clients could set parameters, which SROS2 forbids
        self._list = node.create_client(ListParameters, f'{name}/list_parameters')
        self._get = node.create_client(GetParameters, f'{name}/get_parameters')
        self._was_there = False

    def ask_once(self) -> None:
        """Ask whenever the node has appeared."""
        is_there = self._list.service_is_ready() and self._get.service_is_ready()
        if is_there and not self._was_there:
            answer = self._list.call_async(ListParameters.Request())
            answer.add_done_callback(self._read_names)
        self._was_there = is_there

    def update(self, event: ParameterEvent) -> None:
        """Note parameters that were declared or changed."""
        for parameter in (*event.new_parameters, *event.changed_parameters):
            self.values[parameter.name] = _plain(parameter_value_to_python(parameter.value))

    def as_text(self) -> dict[str, str]:
        """Return the values as JSON."""
        return {name: json.dumps(value) for name, value in self.values.items()}

    def _read_names(self, answer: Future) -> None:
        names = answer.result().result.names
        answer = self._get.call_async(GetParameters.Request(names=names))
        answer.add_done_callback(lambda values: self._read_values(names, values))

    def _read_values(self, names: list[str], answer: Future) -> None:
        self.values = {
            name: _plain(parameter_value_to_python(value))
            for name, value in zip(names, answer.result().values, strict=True)}


def _plain(value: Any) -> Any:
    """Return an array of numbers as a list."""
    return value.tolist() if hasattr(value, 'tolist') else value
