"""
What a user's parameters say is either used or named.

ROS ignores a parameter that no node declares, and a section of a file that is no node's: a slip of
the pen leaves the default in force without a word. Here such a name ends the start, with the
nearest known one. Of a section for all nodes (``/**``) each process looks at the groups of
parameters that its nodes have, such as ``geometry``; what else it does not know may be another
process's, and is named in the log.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
import sys

from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from facade_manipulator.errors import ParameterError
from facade_manipulator.interfaces import NODES
from facade_manipulator.parameter_file import check_names, given_argument, given_in, GivenParameter
from facade_manipulator.parameters import nearest


def require_known_parameters(nodes: Sequence[Node], args: Sequence[str] | None = None) -> None:
    """
    Check the parameters given to a process whose nodes have declared theirs.

    Parameters
    ----------
    nodes : sequence of Node
        All nodes of the process.
    args : sequence of str, optional
        Arguments of the process; those of `sys.argv` if not given.

    Raises
    ------
    ParameterError
        With the name that no node knows and the nearest known one, or with one that has no effect.

    """
    known = {node.get_name(): set(node.list_parameters([], 0).names) for node in nodes}
    renamed = {_original_name(node): node.get_name() for node in nodes}
    everywhere = list(_given(list(sys.argv if args is None else args)))
    _require_effect(nodes, everywhere)
    for given, where in everywhere:
        if renamed.get(given.node, given.node) not in (given.node, *NODES):
            _reject(f"{renamed[given.node]} was started as {given.node} and renamed: nobody reads "
                    f"'{given.name}' of {given.node} ({where}); rename it there, too")
    check_names(everywhere, known, _reject, nodes[0].get_logger().warning)


def _require_effect(
    nodes: Sequence[Node], everywhere: Sequence[tuple[GivenParameter, str]]
) -> None:
    """Reject what ``-p`` gives in vain: to it ROS prefers a node's own section, in any order."""
    own = {(given.node, given.name): (given.value, there) for given, there in everywhere
           if any(_is_section_of(node, given.section) for node in nodes)}
    for given, where in everywhere:
        vain = f"'{given.name}' ({where}) has no effect"
        for node in nodes:
            value, there = own.get((node.get_name(), given.name), (given.value, ''))
            if not given.section and value != given.value:
                _reject(f'{vain} beside that of {node.get_name()} ({there}): change it there, or '
                        'in the same section of a further --params-file')
            if not given.entries and given.section == node.get_name() and not _is_section_of(
                    node, given.section):
                _reject(f"{vain}: ROS looks for {given.section} in no namespace; give "
                        f"'{given.name}' alone")


def _is_section_of(node: Node, section: str) -> bool:
    namespace, _, name = section.rpartition('/')
    return name == node.get_name() and (
        '*' in namespace or namespace.strip('/') == node.get_namespace().strip('/'))


def _original_name(node: Node) -> str:
    """Return the name of a node before it was remapped: that of its module."""
    spec = sys.modules[type(node).__module__].__spec__
    return spec.name.rpartition('.')[2] if spec is not None else ''


def _reject(message: str) -> None:
    raise ParameterError(message)


def _given(words: list[str]) -> Iterator[tuple[GivenParameter, str]]:
    """Yield what stands between ``--ros-args`` and ``--``, and where; ROS has read the files."""
    is_ros = False
    for word, value in pairwise([*words, '']):
        if word in ('--ros-args', '--'):
            is_ros = word == '--ros-args'
        elif is_ros and word == '--params-file':
            yield from given_in(Path(value))
        elif is_ros and word in ('-p', '--param'):
            yield given_argument(value), f'given by {word}'


class NoParameterError(ParameterNotDeclaredException):
    """An unknown parameter, with the nearest known one; rclpy's own message says nothing."""

    def __init__(self, name: str, known: Iterable[str]) -> None:
        Exception.__init__(
            self, f'parameter {name} is not one of this node{nearest(name, known)}')


def name_unknown_parameters(node: Node) -> None:
    """Let whoever sets an unknown parameter of a node that runs learn the nearest known one."""
    def check(parameters: list[Parameter]) -> list[Parameter]:
        for parameter in parameters:
            if not node.has_parameter(parameter.name):
                raise NoParameterError(parameter.name, node.list_parameters([], 0).names)
        return parameters

    node.add_pre_set_parameters_callback(check)
