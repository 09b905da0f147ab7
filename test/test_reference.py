"""
Docs/reference.md lists every parameter of every node as the nodes declare it.

``python test/test_reference.py`` writes the table of the parameters; the text before it is kept.
"""

from collections import defaultdict
from pathlib import Path
import sys
from typing import Any

import rclpy

from facade_manipulator.package_files import config_path
from facade_manipulator.parameters import read_parameters

PAGE = Path(__file__).parent.parent / 'docs/reference.md'
HEAD = """| node | parameter | default | unit | range | live | description |
|---|---|---|---|---|---|---|
"""


def rows_of(nodes: dict[str, Any]) -> list[tuple[str, ...]]:
    """Return the cells of each parameter; a group that several nodes share is one row."""
    owners = defaultdict(list)
    files = {
        name: read_parameters([config_path('manipulator.yaml')], name) for name in nodes
    }
    for name, make in nodes.items():
        node = make()
        for parameter in sorted(node.list_parameters([], 0).names):
            if parameter.startswith(('use_sim_time', 'start_type', 'qos_overrides')):
                continue
            descriptor = node.describe_parameter(parameter)
            value = node.get_parameter(parameter).value
            default = (
                value if isinstance(value, (bool, int, float, str)) else list(value)
            )
            text, _, unit = descriptor.description.rstrip(']').partition(' [')
            limits = descriptor.additional_constraints.removesuffix(
                f' {unit}' if unit else ''
            )
            shipped = files.get(name, {}).get(parameter, default)
            text_of_default = str(default)
            if shipped != default:
                text_of_default += f' ({shipped} in manipulator.yaml)'
            cells = (
                f'`{parameter}`',
                text_of_default,
                unit,
                limits,
                '' if descriptor.read_only else 'yes',
                text,
            )
            owners[cells].append(name)
        if hasattr(node, 'close'):
            node.close()
        node.destroy_node()
    return [(', '.join(names), *cells) for cells, names in owners.items()]


def page() -> str:
    """Return the page with the table of the parameters that the nodes declare."""
    from nodes.node_rig import NODES

    rows = rows_of(NODES)
    written = PAGE.read_text().partition(HEAD)[0]
    return written + HEAD + ''.join(f'| {" | ".join(row)} |\n' for row in rows)


def test_reference_page_lists_every_parameter(ros):
    assert PAGE.read_text() == page(), 'next: run python test/test_reference.py'


if __name__ == '__main__':
    sys.path.append(str(Path(__file__).parent / 'helpers'))
    rclpy.init()
    PAGE.write_text(page())
    rclpy.shutdown()
