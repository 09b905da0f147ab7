"""Imports point one way, and only the nodes know ROS."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import pytest
from support import nodes, syntax

import facade_manipulator

PACKAGE = Path(facade_manipulator.__file__).parent
NAME = PACKAGE.name
BASE = {'errors', 'parameters'}
SETTINGS = BASE | {'files', 'parameter_file', 'resources'}  # and the files they stand in
DRIVES = {'drives.canopen', 'drives.cia402', 'drives.controller'}
# floor: room: the rooms it may import, besides itself
MACHINE = {
    'errors': set(),
    'parameters': {'errors'},
    'arrivals': set(),
    'resources': set(),
    'files': set(),
    'parameter_file': BASE | {'files', 'interfaces'},
    'interfaces': set(),
    'diagnostics': {'interfaces'},
    'kinematics': BASE,
    'messages': BASE | {'kinematics'},
    'estimation': BASE | {'kinematics', 'messages'},
    'prediction': BASE | {'kinematics'},
    'motion': BASE | {'kinematics'},
    'compensation': BASE | {'kinematics', 'prediction', 'motion'},
    'drives.canopen': BASE,
    'drives.cia402': BASE | {'files', 'resources', 'drives.canopen'},
    'drives.controller': BASE | {'files', 'drives.canopen', 'drives.cia402'},
    'loop': BASE | DRIVES | {'kinematics', 'motion'},
    'maintenance': BASE | {'files', 'resources', 'drives.controller'},
}
ALL_OF_IT = set(MACHINE) | {'ros', 'nodes'}
TOOLS = {
    'tools.calibration': SETTINGS | {'estimation', 'interfaces', 'kinematics', 'maintenance',
                                      'messages', 'prediction', 'ros', 'tools.commissioning'},
    'tools.commissioning': SETTINGS | DRIVES | {'kinematics', 'maintenance',
                                             'tools.emergency_stop'},
    'tools.emergency_stop': ALL_OF_IT,
    'tools.stopping': ALL_OF_IT | {'tools.emergency_stop'},
}
LAB = {
    'lab.demo': ALL_OF_IT | {'lab.gondola'},
    'lab.drives': BASE | {'drives.canopen', 'drives.cia402'},
    'lab.gondola': BASE | {'estimation', 'files', 'kinematics', 'motion', 'prediction',
                           'compensation',
                           'resources', 'tools.calibration'},
    'lab.study': SETTINGS | {'kinematics'},
}
ROOMS = MACHINE | TOOLS | LAB
FLOORS = {'drives', 'tools', 'lab'}  # folders of rooms
ROS_ROOMS = {'ros', 'nodes', 'lab.demo'}
ROS_MODULES = {'tools/calibration/measure.py'}  # of rooms without: loaded by who asks for it
PURE_ROOMS = {'errors', 'parameters', 'interfaces', 'diagnostics', 'kinematics', 'messages',
              'estimation',
              'prediction', 'motion', 'compensation', 'lab.gondola'}
DRAWING = {('lab', 'gondola', 'pictures')}
# private names of other libraries: where, and which; tests beside hold the version to them
FOREIGN = {
    'ros/rclpy_internals.py': {
        '_parameter_overrides', '_service_change_state', '_state_machine'},
    'drives/canopen/bus.py': {'_recv_internal'},
}
PUBLIC = {'_asdict', '_exit', '_fields', '_make', '_replace'}  # documented all the same
CLOCKS_AND_IO = {'datetime', 'os', 'random', 'select', 'signal', 'socket', 'subprocess', 'time'}
ROS_PREFIXES, ROS_SUFFIXES = ('rcl', 'ros', 'launch', 'tf2', 'ament'), ('_msgs', '_srvs')
MODULES = sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob('*.py'))


def room_of(parts: tuple[str, ...]) -> str:
    """Return the room of a module's parts below the package: some folders hold rooms."""
    return '.'.join(parts[:2] if parts[0] in FLOORS else parts[:1])


def room_of_module(module: Path) -> str:
    return room_of(module.with_suffix('').parts)


def imports(tree: Iterable[ast.AST], package: tuple[str, ...]) -> set[tuple[str, ...]]:
    """Return every imported name, relative ones resolved, as parts."""
    found = set()
    for node in tree:
        if isinstance(node, ast.Import):
            found |= {tuple(alias.name.split('.')) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            start = package[:len(package) + 1 - node.level] if node.level else ()
            module = (*start, *(node.module or '').split('.')) if node.module else start
            found |= {(*module, alias.name) for alias in node.names}
    return found


@cache
def imports_of(module: Path) -> set[tuple[str, ...]]:
    return imports(nodes(PACKAGE / module), (NAME, *module.parent.parts))


def rooms_imported(names: set[tuple[str, ...]]) -> set[str]:
    """Return the rooms among imported names; what the package itself exports is no room."""
    rooms = {room_of(name[1:]) for name in names
             if name[0] == NAME and name[1:2] != ('config_path',)}
    return rooms - FLOORS


def is_ros(name: str) -> bool:
    return name != 'rosbags' and (
        name.startswith(ROS_PREFIXES) or name.endswith(ROS_SUFFIXES))


def test_the_machine_imports_neither_tools_nor_laboratory():
    machine = {module: rooms_imported(imports_of(module)) for module in MODULES
               if module.parts[0] not in ('tools', 'lab')}
    assert not {module: rooms for module, rooms in machine.items() if rooms & {*TOOLS, *LAB}}


def test_imports_point_one_way():
    wrong = {module: beyond for module in MODULES if room_of_module(module) in ROOMS
             if (beyond := rooms_imported(imports_of(module)) - ROOMS[room_of_module(module)]
                 - {room_of_module(module)})}
    assert not wrong


def test_across_rooms_one_imports_from_faces():
    """A room's face is what its `__init__` imports; what draws is imported by who draws."""
    faces = {room: {name[-1] for name in imports_of(Path(room.replace('.', '/'), '__init__.py'))}
             for room in (*ROOMS, 'ros') if (PACKAGE / room.replace('.', '/')).is_dir()}
    wrong = [f'{module}: {".".join(name)}' for module in MODULES for name in imports_of(module)
             if name[0] == NAME and len(name) > 2 and name[1:4] not in DRAWING
             and (room := room_of(name[1:])) in faces and room != room_of_module(module)
             and not on_the_face(name, room, faces[room])]
    assert not wrong


def on_the_face(name: tuple[str, ...], room: str, face: set[str]) -> bool:
    """Return whether an imported name is the room itself or exported by its face."""
    parts = tuple(room.split('.'))
    return name[1:] == parts or name[1:-1] == parts and name[-1] in face


def test_of_a_room_that_is_imported_whole_one_uses_its_face():
    """As `nodes` do of `ros`: where many words of a room are used, its name stands before them."""
    faces = {(NAME, *folder.parts): {name[-1] for name in imports_of(folder / '__init__.py')}
             for room in (*ROOMS, 'ros') if (
                 PACKAGE / (folder := Path(room.replace('.', '/'))) / '__init__.py').is_file()}
    wrong = {f'{module}: {node.value.id}.{node.attr}' for module in MODULES
             for room in imports_of(module) & faces.keys() for node in nodes(PACKAGE / module)
             if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
             and node.value.id == room[-1] and node.attr not in faces[room]}
    assert not wrong


def test_no_class_name_has_two_meanings():
    names = [node.name for module in MODULES
             for node in syntax(PACKAGE / module).body
             if isinstance(node, ast.ClassDef)]
    assert {name for name in names if names.count(name) > 1} == set()


def test_every_room_says_what_comes_in_and_goes_out():
    wordless = [module for module in MODULES if module.name == '__init__.py'
                and not ast.get_docstring(syntax(PACKAGE / module))]
    assert not wordless


def test_only_the_nodes_import_ros():
    wrong = {module: ros for module in MODULES if room_of_module(module) not in ROS_ROOMS
             and module.as_posix() not in ROS_MODULES
             and (ros := {name[0] for name in imports_of(module) if is_ros(name[0])})}
    assert not wrong


def test_the_core_reads_no_clock_and_does_no_io():
    wrong = {module: impure for module in MODULES if room_of_module(module) in PURE_ROOMS
             if (impure := {name[0] for name in imports_of(module)} & CLOCKS_AND_IO)}
    assert not wrong


def private_names(tree: Iterable[ast.AST]) -> tuple[set[str], set[str]]:
    """Return the names that a module defines, and the private ones that it uses."""
    defined, used = set(), set()
    for node in tree:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            defined.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            defined.add(node.id)
        elif isinstance(node, ast.Attribute):
            (defined if isinstance(node.ctx, ast.Store) else used).add(node.attr)
    return defined, {name for name in used if name[0] == '_' and name[:2] != '__'}


def test_private_names_of_other_libraries_are_used_in_one_place_each():
    names = {module.as_posix(): private_names(nodes(PACKAGE / module))
             for module in MODULES if module.parts[0] not in ('tools', 'lab')}
    ours = PUBLIC.union(*(defined for defined, _ in names.values()))
    foreign = {module: used - ours for module, (_, used) in names.items()}
    assert {module: names for module, names in foreign.items() if names} == FOREIGN
    assert {str(module) for module in MODULES if ('rclpy', 'impl') in {
        name[:2] for name in imports_of(module)}} == {'ros/rclpy_internals.py'}


def test_every_room_has_its_rule():
    assert {room_of_module(module) for module in MODULES} <= {
        *ROOMS, *ROS_ROOMS, 'start', '__init__', *(f'{floor}.__init__' for floor in FLOORS)}


@pytest.mark.parametrize(('source', 'rooms'), [
    ('import facade_manipulator.nodes.driver', {'nodes'}),
    ('from facade_manipulator import nodes, errors', {'nodes', 'errors'}),
    ('from facade_manipulator.drives.canopen.bus import Bus', {'drives.canopen'}),
    ('from ..nodes import driver', {'nodes'}),
    ('from .. import nodes', {'nodes'}),
    ('from . import planar', {'kinematics'}),
    ('def late():\n    from facade_manipulator.drives import canopen', {'drives.canopen'}),
    ('from facade_manipulator import config_path\nimport math', set()),
])
def test_every_form_of_import_is_seen(source, rooms):
    assert rooms_imported(imports(ast.walk(ast.parse(source)), (NAME, 'kinematics'))) == rooms
