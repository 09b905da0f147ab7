"""
Parameter files of a machine, which all tools find, check and print in the same way.

The tools read a file without ROS and reject it as the nodes do. The set-up class of a node reads
the settings that this node declares as ROS parameters.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
import sys
from typing import Any

from facade_manipulator.errors import ParameterError
from facade_manipulator.nodes.node_settings import OF_ROS, parameter_names
from facade_manipulator.parameters import (
    NODES,
    read_parameters,
    read_sections,
    require_known_node,
    unknown,
)


def announce(tool: str, files: Sequence[Path]) -> None:
    """Print the parameter files that a tool reads on standard error."""
    names = ', then '.join(map(str, files))
    print(f'{tool}: parameters of {names}', file=sys.stderr)


def read_machine(files: Sequence[Path], node: str) -> dict[str, Any]:
    """
    Return the parameters that files assign to a node, by full name.

    Raises a ParameterError for a file or a value that the node rejects, and for a name that the
    node does not have. In a section for all nodes, another node may have the name.
    """
    values = read_parameters(files, node)
    own = parameter_names(node, values)
    if all(_is_known(name, own) for name in values):
        return values
    of_any_node = own.union(
        *(parameter_names(other, read_parameters(files, other)) for other in NODES)
    )
    for file in files:
        for section, given in read_sections([file]).items():
            target = require_known_node(section, NODES)
            known = own if target else of_any_node
            for name in given if target in (node, '') else ():
                if not _is_known(name, known):
                    owner = f'{target} has' if target else 'there is'
                    reason = unknown(name, known)
                    raise ParameterError(f'{file} rejected: {owner} {reason}')
    return values


def _is_known(name: str, known: Collection[str]) -> bool:
    return name in known or name.partition('.')[0] in OF_ROS
