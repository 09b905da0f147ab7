"""Parameter files are read as ROS reads them, and written with all that was in them."""

from __future__ import annotations

import pytest

from facade_manipulator import config_path
from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.nodes.settings import DriverSettings
from facade_manipulator.parameter_file import (
    ALL_NODES,
    read_parameters,
    read_settings,
    write_parameters,
)

P = 'ros__parameters'
SCALARS = (
    '1e-3 0x1F -0x1F 017 -017 08 yes Y n Off tRue 1_000 .5 1. +5 -0 0o17 12:30 .inf -.inf inf ~ '
    'null 2026-01-01 \'1\' "yes" [1,2] [.5,1e2] [a,b] [yes,off]').split()
FILES = [
    [f'driver: {{{P}: {{a: 1}}}}'], [f'/driver: {{{P}: {{a: 1}}}}'],
    [f'/gondola_1/driver: {{{P}: {{a: 1}}}}'], [f'gondola_1: {{driver: {{{P}: {{a: 1}}}}}}'],
    [f'/**: {{{P}: {{a: 1}}}}'], [f'/*: {{{P}: {{a: 1}}}}'], [f'/**/*: {{{P}: {{a: 1}}}}'],
    [f'/*/driver: {{{P}: {{a: 1}}}}'], [f'"*/driver": {{{P}: {{a: 1}}}}'],
    [f'/gondola_1/*: {{{P}: {{a: 1}}}}'], [f'/gondola_1/**: {{{P}: {{a: 1}}}}'],
    [f'/**: {{driver: {{{P}: {{a: 1}}}}}}'], [f'/**/driver: {{{P}: {{a: 1}}}}'],
    [f'/**: {{{P}: {{q: {{a: 1}}, q.b: 2, q.c.d: 3, q.a: 4}}}}'],
    [f'/**: {{{P}: {{q.a: 1, q: {{a: 2}}, q: {{b: 3}}}}}}'],
    [f'/**: {{{P}: {{a: 2}}}}\n/driver: {{{P}: {{a: 1}}}}'],
    [f'/driver: {{{P}: {{a: 1}}}}\n/**: {{{P}: {{a: 2}}}}'],
    [f'/driver: {{{P}: {{a: 1}}}}\n/**: {{{P}: {{a: 2}}}}\ndriver: {{{P}: {{a: 3, b: 1}}}}'],
    [f'/**: {{{P}: {{a: 2}}}}', f'/gondola_1/driver: {{{P}: {{a: 3}}}}',
     f'/**: {{{P}: {{a: 4}}}}'],
    [f'/gondola_1/driver: {{{P}: {{a: 3}}}}', f'/**: {{{P}: {{a: 4}}}}'],
    [f'/**:\n  {P}:\n' + ''.join(f'    p{n}: {text}\n' for n, text in enumerate(SCALARS))],
    [''], ['# nothing'],
]


def from_text(folder, texts):
    paths = [folder / f'{number}.yaml' for number in range(len(texts))]
    for path, text in zip(paths, texts, strict=True):
        path.write_text(text)
    return paths


@pytest.mark.parametrize('namespace', ['', '/gondola_1', '/building/gondola_1'])
@pytest.mark.parametrize('texts', FILES)
def test_a_tool_reads_what_a_node_of_rclpy_reads(ros, tmp_path, texts, namespace):
    paths = from_text(tmp_path, texts)
    arguments = [word for path in paths for word in ('--params-file', str(path))]
    node = ros.node('driver', namespace=namespace, cli_args=['--ros-args', *arguments])
    expected = {name: one.value for name, one in node._parameter_overrides.items()}
    found = read_parameters(paths, 'driver', namespace)
    assert found == expected and list(map(type, found.values())) == [
        type(expected[name]) if not hasattr(expected[name], 'tolist') else list for name in found]


@pytest.mark.parametrize('section', [
    'driver', '/gondola_1/driver', '/*/driver', '/*', '/gondola_1/**', 'a/b/driver', '/**'])
def test_without_a_namespace_it_is_that_which_the_file_names(tmp_path, section):
    (path,) = from_text(tmp_path, [f'{section}: {{{P}: {{a: 11}}}}'])
    assert read_parameters([path], 'driver') == {'a': 11}


@pytest.mark.parametrize('text, reason', [
    (f'a/driver: {{{P}: {{a: 1}}}}\nb/driver: {{{P}: {{a: 2}}}}', 'namespaces /a, /b: give each'),
    (f'/**/drvier: {{{P}: {{a: 1}}}}', "no node is called 'drvier': did you mean 'driver'"),
    ('/**: 1', '/[*][*] is not a table'), ('[', 'cannot be read'), ('1', 'not a parameter file'),
    (f'/**/driver: {{{P}: {{geometri.stroke: [0.0, 1.0]}}}}', "did you mean 'geometry'"),
    (f'/**/driver: {{{P}: {{geometry.carriage_gap: 0.03}}}}', 'geometry: not the same for'),
])
def test_what_is_not_understood_is_named(tmp_path, text, reason):
    (path,) = from_text(tmp_path, [text])
    with pytest.raises(ParameterError, match=reason):
        read_settings([path], ALL_NODES, 'geometry', Geometry)


def test_settings_without_a_section_are_read(tmp_path):
    (path,) = from_text(tmp_path, [
        f'driver: {{{P}: {{software_stop_topics: [stop], q.a: 1, joint_states_rate: 1.0}}}}'])
    assert read_settings([path], 'driver', '', DriverSettings) == DriverSettings(
        software_stop_topics=('stop',), joint_states_rate=1.0)


def test_integer_in_place_of_a_double_is_rejected(tmp_path):
    (path,) = from_text(tmp_path, [f'driver: {{{P}: {{joint_states_rate: 1}}}}'])
    with pytest.raises(ParameterError, match='rate = 1 is an integer, expected a double'):
        read_settings([path], 'driver', '', DriverSettings)


@pytest.mark.parametrize('text, line', [
    (f'driver:\n  {P}:\n    q1.lead: 0.02  # of the box\n', '    q1.lead: 0.01  # of the box'),
    (f'/g/driver:\n  {P}:\n    q1:\n      lead: 0.02  # m\n', '      lead: 0.01   # m'),
    (f'/**:\n  {P}:\n    q1: {{node_id: 11}}  # swapped\n', 'q1: {node_id: 11, lead: 0.01}'),
    (f'g:\n  driver:\n    {P}: {{q1: {{lead: 0.02}}, q1.lead: 0.03}}\n', 'q1.lead: 0.01'),
    (f'/**/driver:\n  {P}:\n    q2: {{lead: 0.02}}\n', '    q1.lead: 0.01'),
    (f'/**/driver:\n  {P}:\n    q1:\n      x:\n        - 1\n        - 2  # m\n    y: 1',
     '      lead: 0.01'),
    (f'/**/ik_service:\n  {P}: {{a: 1}}\n', '/**/driver:'), ('', '/**/driver:'),
])
def test_a_value_is_written_where_the_node_reads_it_and_all_else_stays(tmp_path, text, line):
    (source,) = from_text(tmp_path, [f'# ours\n{text}'])
    source.chmod(0o640)
    link = tmp_path / 'machine.yaml'
    link.symlink_to(source.name)
    before = read_parameters([source], 'driver')
    write_parameters(link, link, 'driver', {'q1': {'lead': 0.01}})
    written = source.read_text()
    assert line.split() and ' '.join(line.split()) in ' '.join(written.split())
    assert read_parameters([link], 'driver') == before | {'q1.lead': 0.01}
    assert written.startswith('# ours\n') and written.count(P) == text.count(P) + (
        '/**/driver' in line) and written.count('#') == text.count('#') + 1
    assert link.is_symlink() and source.stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize('value', ['y', '1_0', '12:30', '.5', 'a: b # c', '"', 'Tür', 3, 1e-7, [
    0.1, 2.0]])
def test_what_was_written_is_read_again_in_place_of_any_other(tmp_path, value):
    for text in ('q1: {x: 1}', 'q1.x: [1, 2]', 'q1: {x: 2, y: 1}', '\n    q1:\n      x:\n    '
                 '    - 1\n        - 2\n    y: 1\n'):
        (source,) = from_text(tmp_path, [f'driver:\n  {P}: {text}' if text[0] == '\n' else
                                         f'driver: {{{P}: {{{text}}}}}'])
        before = read_parameters([source], 'driver')
        write_parameters(source, source, 'driver', {'q1': {'x': value}})
        assert read_parameters([source], 'driver') == before | {'q1.x': value}


def test_a_file_in_which_more_would_change_stays_as_it_was(tmp_path):
    text = f'driver: {{{P}: {{q1: &one {{x: 1}}, q2: *one}}}}'
    (source,) = from_text(tmp_path, [text])
    with pytest.raises(ParameterError, match="driver would read {'q1.x': 2, 'q2.x': 2} instead"):
        write_parameters(source, source, 'driver', {'q1': {'x': 2}})
    assert source.read_text() == text


def test_the_mechanism_is_written_for_all_nodes(tmp_path):
    target = tmp_path / 'machine.yaml'
    write_parameters(config_path('manipulator.yaml'), target, ALL_NODES,
                     {'geometry': {'link_length': 0.3531, 'rail_angle': 0.001}})
    geometry = read_settings([target], ALL_NODES, 'geometry', Geometry)
    assert (geometry.link_length, geometry.rail_angle) == (0.3531, 0.001)
    assert target.read_text().count('geometry:') == 1
