"""Imports point one way, and only the nodes know ROS."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import facade_manipulator

PACKAGE = Path(facade_manipulator.__file__).parent
NAME = PACKAGE.name
BASE = {'errors', 'parameters'}
# layer: the layers it may import, besides itself
LAYERS = {
    'errors': set(),
    'parameters': {'errors'},
    'resources': set(),
    'files': set(),
    'kinematics': BASE,
    'workspace': BASE | {'kinematics', 'resources', 'files'},
    'prediction': BASE | {'kinematics', 'control'},
    'control': BASE | {'kinematics', 'prediction'},
    'drives': BASE | {'resources', 'files'},
    'simulation': BASE | {'kinematics', 'control', 'prediction', 'resources'},
}
ROS_LAYERS = {'nodes', 'client'}  # these may import everything
PURE_LAYERS = {'errors', 'parameters', 'kinematics', 'control', 'prediction', 'simulation'}
CLOCKS_AND_IO = {'datetime', 'os', 'random', 'select', 'signal', 'socket', 'subprocess', 'time'}
ROS_PREFIXES, ROS_SUFFIXES = ('rcl', 'ros', 'launch', 'tf2', 'ament'), ('_msgs', '_srvs')
MODULES = sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob('*.py'))


def layer_of(module: Path) -> str:
    return module.parts[0].removesuffix('.py')


def imports(source: str, package: tuple[str, ...]) -> set[tuple[str, ...]]:
    """Return every imported name, relative ones resolved, as parts."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {tuple(alias.name.split('.')) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            start = package[:len(package) + 1 - node.level] if node.level else ()
            module = (*start, *(node.module or '').split('.')) if node.module else start
            found |= {(*module, alias.name) for alias in node.names}
    return found


def imports_of(module: Path) -> set[tuple[str, ...]]:
    return imports((PACKAGE / module).read_text(), (NAME, *module.parent.parts))


def layers_imported(names: set[tuple[str, ...]]) -> set[str]:
    """Return the layers among imported names; what the package itself exports is no layer."""
    return {name[1] for name in names if name[0] == NAME and name[1:2] != ('config_path',)}


def is_ros(name: str) -> bool:
    return name.startswith(ROS_PREFIXES) or name.endswith(ROS_SUFFIXES)


def test_imports_point_one_way():
    wrong = {module: beyond for module in MODULES if layer_of(module) in LAYERS
             if (beyond := layers_imported(imports_of(module)) - LAYERS[layer_of(module)]
                 - {layer_of(module)})}
    assert not wrong


def test_only_the_nodes_import_ros():
    wrong = {module: ros for module in MODULES if layer_of(module) not in ROS_LAYERS
             if (ros := {name[0] for name in imports_of(module) if is_ros(name[0])})}
    assert not wrong


def test_the_core_reads_no_clock_and_does_no_io():
    wrong = {module: impure for module in MODULES if layer_of(module) in PURE_LAYERS
             if (impure := {name[0] for name in imports_of(module)} & CLOCKS_AND_IO)}
    assert not wrong


def test_every_layer_has_its_rule():
    assert {layer_of(module) for module in MODULES} <= {*LAYERS, *ROS_LAYERS, '__init__'}


@pytest.mark.parametrize(('source', 'layers'), [
    ('import facade_manipulator.nodes.driver', {'nodes'}),
    ('from facade_manipulator import nodes, errors', {'nodes', 'errors'}),
    ('from facade_manipulator.drives.bus import Bus', {'drives'}),
    ('from ..nodes import driver', {'nodes'}),
    ('from .. import nodes', {'nodes'}),
    ('from . import planar', {'kinematics'}),
    ('def late():\n    from facade_manipulator.drives import bus', {'drives'}),
    ('from facade_manipulator import config_path\nimport math', set()),
])
def test_every_form_of_import_is_seen(source, layers):
    assert layers_imported(imports(source, (NAME, 'kinematics'))) == layers
