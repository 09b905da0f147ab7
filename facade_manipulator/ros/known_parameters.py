"""
What a user's parameters say is either used or named.

ROS ignores a parameter that no node declares, and a section of a file that is no node's: a slip of
the pen leaves the default in force without a word. Here such a name ends the start, with the
nearest known one. Of a section for all nodes (``/**``) each process looks at the groups of
parameters that its nodes have, such as ``geometry``; what else it does not know may be another
process's, and is named in the log. A name of the release before is accepted with a warning.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
import sys
from typing import NamedTuple

from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from facade_manipulator.errors import ParameterError
from facade_manipulator.parameter_file import given_parameters, NODE_NAMES
from facade_manipulator.parameters import nearest

OF_ROS = ('use_sim_time', 'start_type_description_service', 'qos_overrides')
# of the release before, one line a name, to be deleted one release later: the present name, or
# what holds now; a name that ends in ``.*`` stands for all below it
RENAMED: dict[str, str] = {}
REMOVED: dict[str, str] = {}


class Given(NamedTuple):
    """A parameter that somebody has given: for which node (``*``, ``**`` or '' all), and where."""

    node: str
    name: str
    where: str


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
        With the name that no node knows and the nearest known one.

    """
    known = {node.get_name(): set(node.list_parameters([], 0).names) for node in nodes}
    everything = set().union(*known.values())
    for given in _given(list(sys.argv if args is None else args)):
        if given.node in known:
            _require(given, known[given.node], f'{given.node} has no parameter', _reject)
        elif given.node and set(given.node) != {'*'}:
            if given.node not in NODE_NAMES:
                _require(given._replace(name=given.node), {*NODE_NAMES, *known},
                         'no node is called', _reject)
        else:
            group = given.name.partition('.')[0] + '.'
            is_ours = not given.node or any(name.startswith(group) for name in everything)
            _require(given, everything, f'{" and ".join(known)}: no parameter',
                     _reject if is_ours else nodes[0].get_logger().warning)


def _reject(message: str) -> None:
    raise ParameterError(message)


def _require(
    given: Given, known: set[str], what: str, complain: Callable[[str], object]
) -> None:
    name = given.name
    if name in known or name.split('.')[0] in OF_ROS or name in RENAMED or _advice(name):
        return
    complain(f"{what} '{name}' ({given.where}){nearest(name, known)}")


def _given(words: list[str]) -> Iterator[Given]:
    """Yield what stands between ``--ros-args`` and ``--``."""
    is_ros = False
    for word, value in pairwise([*words, '']):
        if word in ('--ros-args', '--'):
            is_ros = word == '--ros-args'
        elif is_ros and word == '--params-file':
            yield from _given_in(Path(value))
        elif is_ros and word in ('-p', '--param'):
            node, _, name = value.partition(':=')[0].rpartition(':')
            yield Given(node, name, f'given by {word}')


def _given_in(file: Path) -> Iterator[Given]:
    """Yield what a file gives that ROS has read already."""
    for one in given_parameters(file):
        yield Given(one.node, one.name, f'in {file.name}')


class NoParameterError(ParameterNotDeclaredException):
    """An unknown parameter, with what there is in its place."""

    def __init__(self, name: str, advice: str) -> None:
        Exception.__init__(self, f'parameter {name} {advice}')


def accept_old_names(node: Node) -> None:
    """
    Accept the parameter names of the release before, with a warning; call it before `declare`.

    A renamed parameter of a file or an override, and one that is set while the node runs, has its
    effect under the present name; one that is removed has none.

    Notes
    -----
    Overrides are in a private attribute of rclpy's node (tried on 7.1.6). Without it old names in
    files are ignored, as every unknown name is; `ros2 param set` works all the same.

    """
    overrides = getattr(node, '_parameter_overrides', {})
    for name in sorted(overrides):
        if name in RENAMED:
            overrides.setdefault(RENAMED[name], _renamed(node, overrides[name]))
        elif instead := _advice(name):
            node.get_logger().warning(
                f'parameter {name} has no effect: it {instead}; delete it from the file')

    def present(parameter: Parameter) -> Parameter:
        name = parameter.name
        if node.has_parameter(name):
            return parameter
        if name in RENAMED:
            return _renamed(node, parameter)
        raise NoParameterError(name, _advice(name) or (  # of which rclpy says []
            f'is not one of this node{nearest(name, node.list_parameters([], 0).names)}'))

    node.add_pre_set_parameters_callback(lambda parameters: list(map(present, parameters)))


def _renamed(node: Node, parameter: Parameter) -> Parameter:
    """Return a parameter under its present name, with a warning."""
    new = RENAMED[parameter.name]
    node.get_logger().warning(
        f'parameter {parameter.name} is called {new} now; the old name works in this release '
        'only: use the new one')
    return Parameter(new, value=parameter.value)


def _advice(name: str) -> str | None:
    """Return what holds in place of a removed parameter, None if there never was one."""
    return REMOVED.get(name) or REMOVED.get(f'{name.partition(".")[0]}.*')
