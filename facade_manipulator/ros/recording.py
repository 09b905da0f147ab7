"""What a recorder needs of ROS: definitions of messages, parameters of another node."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from importlib import import_module
import re
from reprlib import repr as quoted
from typing import Any

from rcl_interfaces.msg import ParameterEvent, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

from facade_manipulator import interfaces
from facade_manipulator.errors import InputError
from facade_manipulator.resources import installed_shares
from facade_manipulator.ros.diagnostics import Rejections
from facade_manipulator.ros.interfaces import client

_TYPE = re.compile(r'(\w+)/(\w+)')
_RULE = '=' * 80


class ParameterReader:
    """
    Read all parameters of a node, as they are now, without waiting for it.

    Parameters
    ----------
    node : rclpy.node.Node
        Who asks.
    name : str
        Who is asked.
    rejections : Rejections
        Count values that cannot be read.

    Attributes
    ----------
    values : dict
        Parameters by name; empty until the node has answered.

    """

    def __init__(self, node: Node, name: str, rejections: Rejections) -> None:
        self.values: dict[str, Any] = {}
        self._node, self._rejections = node, rejections
        self._services = tuple(
            interfaces.SERVICES_BY_NAME[f'{name}/{what}'] for what in interfaces.READ)
        self._clients: tuple[Client, ...] = ()  # a reader costs with every message that comes
        self._was_there = self._is_asked = self._is_over = False

    def ask_once(self) -> None:
        """Ask whenever the node has appeared; to be called again and again."""
        is_there = self._node.count_services(self._services[0].name) > 0
        if is_there and not self._was_there:
            self.open()
        self._was_there = is_there
        if self._is_over or not is_there:
            self._close()
        elif self._clients and not self._is_asked:
            self._ask(*self._clients)

    def open(self) -> None:
        """Make the clients, which last until the node has answered or is gone."""
        # not rclpy's AsyncParameterClient: its clients could set parameters, which SROS2 forbids
        self._clients = tuple(client(self._node, one) for one in self._services)
        self._is_asked = self._is_over = False

    def _close(self) -> None:
        for one in self._clients:
            self._node.destroy_client(one)
        self._clients = ()

    def _ask(self, lists: Client, gets: Client) -> None:
        if lists.service_is_ready() and gets.service_is_ready():
            self._is_asked = True
            answer = lists.call_async(ListParameters.Request())
            answer.add_done_callback(partial(self._read_names, gets))

    def update(self, event: ParameterEvent) -> None:
        """Note parameters that were declared or changed."""
        self._note((one.name, one.value) for one in (
            *event.new_parameters, *event.changed_parameters))

    def _read_names(self, gets: Client, answer: Future) -> None:
        if gets in self._clients:
            names = answer.result().result.names
            answer = gets.call_async(GetParameters.Request(names=names))
            answer.add_done_callback(partial(self._read_values, names))

    def _read_values(self, names: list[str], answer: Future) -> None:
        self.values = {}
        self._note(zip(names, answer.result().values, strict=False))
        self._is_over = True

    def _note(self, values: Iterable[tuple[str, ParameterValue]]) -> None:
        for name, value in values:
            with self._rejections:
                self.values[name] = _plain(name, value)


def _plain(name: str, value: ParameterValue) -> Any:
    """Return a parameter's value, an array of numbers as a list."""
    try:
        plain = parameter_value_to_python(value)
    except RuntimeError:
        raise InputError('parameter', f'parameter {quoted(name)} is of unknown type '
                         f'{value.type}') from None
    return plain.tolist() if hasattr(plain, 'tolist') else plain


def message_type(kind: type) -> tuple[str, str]:
    """
    Return name and definition of a message class, followed by those of all that it contains.

    Raises
    ------
    OSError, LookupError
        If the package's ``.msg`` files are not installed.

    References
    ----------
    MCAP registry, schema encoding ``ros2msg``.

    """
    parts = [f'{_RULE}\nMSG: {_package(part)}/{part.__name__}\n{_source(part)}'
             for part in dict.fromkeys(_contained(kind))]
    return f'{_package(kind)}/msg/{kind.__name__}', ''.join([_source(kind), *parts])


def _package(kind: type) -> str:
    return kind.__module__.partition('.')[0]


def _source(kind: type) -> str:
    file = f'msg/{kind.__name__}.msg'
    for share in installed_shares(_package(kind)):
        if (share / file).is_file():
            return (share / file).read_text(encoding='utf-8').rstrip() + '\n'
    raise LookupError(f'{file} of {_package(kind)} is not installed')


def _contained(kind: Any) -> Iterator[type]:
    for field in kind.get_fields_and_field_types().values():
        for package, name in _TYPE.findall(field):
            part = getattr(import_module(f'{package}.msg'), name)
            yield part
            yield from _contained(part)
