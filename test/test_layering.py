"""Imports point down the layers: no ROS below `topics`, no clock or socket in mathematics."""

import ast
from functools import cache
from pathlib import Path

import facade_manipulator

PACKAGE = Path(facade_manipulator.__file__).parent
BASE = 'command_line covariance errors package_files parameters rejections timeouts'.split()
MATHEMATICS = 'kinematics estimation prediction motion compensation'
MACHINE = (
    f'{MATHEMATICS} canopen drives control_loop topics nodes nodes.planar_messages '
    'config_path'
)
LAYERS = {  # folder or module, and its permitted imports besides itself and BASE
    **dict.fromkeys(BASE, ''),
    'kinematics': '',
    'nodes.planar_messages': 'kinematics',
    'estimation': 'kinematics',
    'prediction': 'kinematics',
    'motion': 'kinematics',
    'study': 'kinematics',
    'compensation': 'kinematics prediction motion',
    'canopen': '',
    'drives': 'kinematics motion canopen config_path',
    'control_loop': 'kinematics motion canopen drives',
    **dict.fromkeys(('topics', 'nodes', 'client'), f'{MACHINE} client'),
    **dict.fromkeys(
        ('tools', 'simulation'), f'{MACHINE} client tools simulation study'
    ),
}
IMPURE = {
    'time',
    'datetime',
    'socket',
    'select',
    'signal',
    'subprocess',
    'os',
    'random',
}


@cache
def imported_names(path: Path) -> list[str]:
    """Return the modules and names that a file imports, such as ``'can.Bus'``."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found += [f'{node.module}.{alias.name}' for alias in node.names]
    return found


def layer_of(name):
    return next((layer for layer in LAYERS if f'{name}.'.startswith(f'{layer}.')), name)


def test_imports_point_down_the_layers():
    for path in PACKAGE.rglob('*.py'):
        layer = layer_of('.'.join(path.relative_to(PACKAGE).with_suffix('').parts))
        allowed = {layer, *BASE, *LAYERS.get(layer, '').split()}
        for top, _, rest in (name.partition('.') for name in imported_names(path)):
            assert top != PACKAGE.name or layer_of(rest) in allowed, f'{path}: {rest}'
            is_ros = top == 'rclpy' or top.endswith('_msgs')
            assert not is_ros or 'topics' in allowed, f'{path}: {top}'
            assert top != 'mujoco' or layer == 'simulation', f'{path}: {top}'
            assert top not in IMPURE or layer not in MATHEMATICS.split(), (
                f'{path}: {top}'
            )
