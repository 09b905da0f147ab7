"""Settings check their values; parameter files are read as ROS reads them."""

from contextlib import nullcontext
from dataclasses import dataclass
import math
import re

import pytest
from rclpy.exceptions import InvalidTopicNameException
from rclpy.expand_topic_name import expand_topic_name
from rclpy.validate_full_topic_name import validate_full_topic_name

from facade_manipulator.drives.profile import load_profile
from facade_manipulator.errors import ParameterError
from facade_manipulator.nodes.node_parameters import reject_unknown_parameters
from facade_manipulator.nodes.node_settings import parameter_names
from facade_manipulator.parameters import (
    from_mapping,
    parameter,
    ParameterSource,
    read_parameters,
    read_value,
    settings,
)
from facade_manipulator.simulation.world.scenario import load_scenario

P = 'ros__parameters'


@settings
class Sample:
    """Settings like those of a core object."""

    low: float = parameter(
        'Lower bound', default=0.1, unit='m', minimum=0.0, maximum=1.0
    )
    high: float = parameter(
        'Upper bound', default=0.9, unit='m', minimum=0.0, maximum=1.0
    )
    count: int = parameter('Number of samples', default=3, minimum=1, maximum=9)
    span: tuple[float, ...] = parameter(
        'First and last position',
        default=(0.0, 1.0),
        unit='m',
        minimum=-5.0,
        maximum=5.0,
        elements=('first', 'last'),
    )

    def __post_init__(self) -> None:
        if self.low >= self.high:
            raise ParameterError(
                f'low = {self.low:g} m is not below high = {self.high:g} m'
            )


@pytest.mark.parametrize(
    'values, message',
    [
        (
            {'lwo': 0.2},
            "no parameter 'group.lwo', which is similar to 'group.low'; next: correct",
        ),
        ({'low': 1}, 'group.low = 1, expected a double such as 1.0; next: write 1.0'),
        (
            {'low': 'much'},
            "group.low = 'much', expected a double such as 1.0; next: set a double",
        ),
        (
            {'count': True},
            'group.count = True, expected an integer; next: set an integer',
        ),
        ({'span': 1.0}, r'group.span = 1.0 is not a list; next: write \[1.0\]'),
        (
            {'span': [0.0, math.inf]},
            'group.span = inf is not a finite number; next: set a number',
        ),
        (
            {'span': [0.0, 1.0, 2.0]},
            'group.span has 3 elements, expected 2: first, last; next: write these 2',
        ),
        (
            {'low': -0.5},
            'group.low = -0.5 m is below its minimum 0 m; next: set at least 0 m',
        ),
        (
            {'high': 1.5},
            'group.high = 1.5 m is above its maximum 1 m; next: set at most 1 m',
        ),
        ({'low': 0.95}, 'group.low = 0.95 m is not below high'),
    ],
)
def test_wrong_value_is_rejected_with_the_full_name(values, message):
    with pytest.raises(ParameterError, match=message):
        from_mapping(Sample, values, 'group')


def test_missing_values_have_given_defaults():
    made = from_mapping(Sample, {'span': [0.0, 2.0]}, low=0.2)
    assert made == Sample(low=0.2, span=(0.0, 2.0))


def test_source_reads_a_group_and_collects_its_names():
    source = ParameterSource({'g.count': 4, 'g.other': 1, 'count': 5})
    found = source.read(Sample, 'g', ['count', 'low'], high=0.8)
    assert found == Sample(high=0.8, count=4)
    assert source.names == {'g.count', 'g.low'}


@dataclass(frozen=True)
class Nested:
    """Settings of a file with a table in a table."""

    name: str = ''
    sample: Sample = Sample(low=0.3)
    points: tuple[tuple[float, float], ...] = ()


def test_inner_table_keeps_the_defaults_of_its_field():
    content = {'sample': {'high': 0.7}, 'points': [[0, 1.5]]}
    sample = Sample(low=0.3, high=0.7)
    assert from_mapping(Nested, content) == Nested(sample=sample, points=([0, 1.5],))


@pytest.mark.parametrize(
    'data, message',
    [
        ({'sample': {'lwo': 0.1}}, "no parameter 'sample.lwo', .* 'sample.low'"),
        ({'sample': {'high': 0.2}}, 'sample.low = 0.3 m is not below high'),
        ({'sample': 3}, 'sample = 3 is not a table; next: write NAME: VALUE'),
        ({'name': 3}, "name = 3, expected a value such as ''; next: correct it"),
        (['name'], 'the file = .* is not a table'),
    ],
)
def test_wrong_inner_table_is_rejected_with_the_full_name(data, message):
    with pytest.raises(ParameterError, match=message):
        from_mapping(Nested, data)


SCALARS = (
    '1e-3 -2E4 1.5e3 0x1F -17 yes Off true .5 1. +5 -0 0 .inf -.inf \'1\' "yes" a '
    '[1,2] [.5,1e2] [a,b] [yes,off] 1_000 1:30 0b11 00.5 0o17 2026-01-01 -0x1F 0X1F +.5 1.e3'
).split()
FILES = [
    [f'/driver: {{{P}: {{a: 1}}}}'],
    [f'/gondola_1/driver: {{{P}: {{a: 1}}}}'],
    [f'gondola_1: {{driver: {{{P}: {{a: 1}}}}}}'],
    [f'/**: {{{P}: {{a: 1}}}}'],
    [f'/gondola_1/*: {{{P}: {{a: 1}}}}'],
    [f'/**: {{driver: {{{P}: {{a: 1}}}}}}'],
    [f'/**/driver: {{{P}: {{a: 1}}}}'],
    [f'/**: {{{P}: {{q: {{a: 1}}, q.b: 2, q.c.d: 3, q.a: 4}}}}'],
    [f'/**: {{{P}: {{a: 2}}}}\n/**/driver: {{{P}: {{a: 1}}}}'],
    [f'/**/driver: {{{P}: {{a: 1}}}}\n/**: {{{P}: {{a: 2}}}}'],
    [
        f'/**: {{{P}: {{a: 2}}}}',
        f'/gondola_1/driver: {{{P}: {{a: 3}}}}',
        f'/**: {{{P}: {{a: 4, b: 1}}}}',
    ],
    [f'/**/driver: {{{P}: {{a: 3, b: 1}}}}', f'/**/driver: {{{P}: {{a: 4}}}}'],
    [
        f'/**:\n  {P}:\n'
        + ''.join(f'    p{n}: {text}\n' for n, text in enumerate(SCALARS))
    ],
    [''],
    ['# nothing'],
]


def write_files(folder, texts):
    paths = [folder / f'{number}.yaml' for number in range(len(texts))]
    for path, text in zip(paths, texts, strict=True):
        path.write_text(text)
    return paths


def plain(value):
    """Return a value of a parameter, an array as a list."""
    return value.tolist() if hasattr(value, 'tolist') else value


@pytest.mark.parametrize('texts', FILES)
def test_tool_reads_parameter_files_as_rclpy_does(ros, tmp_path, texts):
    paths = write_files(tmp_path, texts)
    arguments = []
    for path in paths:
        arguments += ['--params-file', str(path)]
    namespace = 'gondola_1' if 'gondola_1' in ''.join(texts) else ''
    node = ros.node('driver', namespace=namespace, cli_args=['--ros-args', *arguments])
    overrides = node._parameter_overrides.items()
    expected = {name: plain(one.value) for name, one in overrides}
    found = read_parameters(paths, 'driver')
    assert found == expected
    for name, value in found.items():
        assert type(value) is type(expected[name])


@pytest.mark.parametrize(
    'text, reason',
    [
        (
            f'a/driver: {{{P}: {{a: 1}}}}\nb/driver: {{{P}: {{a: 2}}}}',
            'several machines: a/driver',
        ),
        (
            f'/**/drvier: {{{P}: {{a: 1}}}}',
            "no node is called 'drvier', which is similar to 'driver'; next",
        ),
        ('/**: 1', 'not a parameter file'),
        ('[', 'cannot be read'),
        ('1', 'not a parameter file'),
        (f'/**/driver: {{{P}: {{a: }}}}', 'not a parameter file'),
    ],
)
def test_unreadable_parameter_file_is_rejected(tmp_path, text, reason):
    with pytest.raises(ParameterError, match=reason):
        read_parameters(write_files(tmp_path, [text]), 'driver')
    with pytest.raises(FileNotFoundError, match='nowhere.yaml'):
        read_parameters([tmp_path / 'nowhere.yaml'], 'driver')


@pytest.mark.parametrize('number', ['00012345', '00089', '-010', '00', '0_7'])
@pytest.mark.parametrize('kind', ['parameters', 'argument', 'profile', 'scenario'])
def test_number_with_leading_zeros_is_rejected(tmp_path, kind, number):
    path = tmp_path / 'user.yaml'
    text = {
        'parameters': f'/**/driver: {{{P}: {{q1: {{serial_number: {number}}}}}}}',
        'profile': f'objects:\n  - {{index: {number}}}',
        'scenario': f'seed: {number}',
    }
    path.write_text(text.get(kind, ''))

    def read_argument():
        reject_unknown_parameters([], ['-p', f'q1.serial_number:={number}'])

    read = {
        'parameters': lambda: read_parameters([path], 'driver'),
        'argument': read_argument,
        'profile': lambda: load_profile(str(path)),
        'scenario': lambda: load_scenario(str(path)),
    }
    with pytest.raises(
        ParameterError, match=f'{number} has leading zeros.*; next: write'
    ):
        read[kind]()


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        (
            'a: 1\nb: 0_',
            "line 2: 0_ has leading zeros.*write 0 for .*or '0_' for a text",
        ),
        ('-0_', 'line 1: -0_ has leading zeros'),
        ('0__1', 'line 1: 0__1 has leading zeros.*write 1 for'),
        (
            'a: 1\nb: !!int abc',
            'line 2: abc is not a value of the type int; next: corr',
        ),
        ('!!int [1]', 'not a value of the type int'),
        ('!!float abc', 'line 1: abc is not a value of the type float'),
        ('!!bool x', 'line 1: x is not a value of the type bool'),
        ('!!timestamp x', 'line 1: x is not a value of the type timestamp'),
        ('9' * 5000, 'line 1: 9{40}… is not a value of the type int'),
        ('[' * 3000, 'nested too deeply'),
    ],
)
def test_yaml_value_without_its_type_is_rejected(text, message):
    with pytest.raises(ParameterError, match=message):
        read_value(text)


TOPIC_PARAMETERS = {
    'software_stop_topics': 'driver',
    'distances': 'disturbance_estimator',
    'fixes': 'disturbance_estimator',
    'poses': 'disturbance_estimator',
}
TOPICS = (
    'fix x',
    '1fix',
    'a/1',
    'a//b',
    'a/',
    '/',
    'a-b',
    'é',
    'a\n',
    'fix',
    '_a1/b',
    '/a/b',
    '~/a',
)


@pytest.mark.parametrize('name', TOPIC_PARAMETERS)
@pytest.mark.parametrize('topic', TOPICS)
def test_topic_names_are_accepted_as_in_ros(name, topic):
    try:
        validate_full_topic_name(expand_topic_name(topic, 'node', '/gondola_1'))
        rejection = nullcontext()
    except (InvalidTopicNameException, ValueError):
        message = (
            f'{name} contains {topic!r}, which is not the name of a topic; next: use'
        )
        rejection = pytest.raises(ParameterError, match=re.escape(message))
    with rejection:
        parameter_names(TOPIC_PARAMETERS[name], {name: ['other', topic]})


def test_table_that_contains_itself_is_rejected(tmp_path):
    path = tmp_path / 'user.yaml'
    path.write_text(f'/**/driver: {{{P}: &a {{b: *a}}}}')
    with pytest.raises(
        ParameterError, match='user.yaml cannot be read: a table contains'
    ):
        read_parameters([path], 'driver')


def test_quoted_digits_with_leading_zeros_are_a_text():
    assert read_value("'007'") == '007'
