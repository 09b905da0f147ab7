"""Messages for an operator: one text, one next step."""

import ast
import errno
from functools import cache
import math
from pathlib import Path
import re

from hypothesis import given
from hypothesis import strategies as st
import pytest

import facade_manipulator
from facade_manipulator.errors import (
    attributed,
    compared,
    DriveObjectError,
    file_sentence,
    InputError,
    joined,
    LimitError,
    ManipulatorError,
    NEXT,
    ParameterError,
    require_recent,
)
from facade_manipulator.kinematics import Geometry, Mechanism, Pose
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.parameters import from_mapping, parameter_fields

PACKAGE = Path(facade_manipulator.__file__).parent
DOUBLED = re.compile(r'\b([a-z_]{2,}):? \1\b', re.IGNORECASE)
# folders whose messages reach a user of the nodes
FOLDERS = (
    'kinematics estimation prediction compensation motion nodes control_loop drives'
)


def family(kind):
    """Return an error class and all classes below it."""
    found = [kind]
    for child in kind.__subclasses__():
        found += family(child)
    return found


def text_of(joined: ast.JoinedStr) -> str:
    """Return the text of a formatted string; ``{}`` replaces a value."""
    parts = []
    for part in joined.values:
        parts.append(part.value if isinstance(part, ast.Constant) else '{}')
    return ''.join(parts)


def ids_of_parts(tree: ast.AST) -> set[int]:
    """Return the ids of the parts of all formatted strings."""
    parts = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            parts |= {id(part) for part in node.values}
    return parts


@cache
def texts():
    """Return the texts of the package with their places; ``{}`` replaces a value."""
    found = []
    for path in sorted(PACKAGE.rglob('*.py')):
        if path.relative_to(PACKAGE).parts[0] not in FOLDERS.split():
            continue
        tree = ast.parse(path.read_text())
        parts = ids_of_parts(tree)
        for node in ast.walk(tree):
            if isinstance(node, ast.JoinedStr):
                text = text_of(node)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                text = '' if id(node) in parts else node.value
            else:
                continue
            if ' ' in text and '\n' not in text:
                found.append((f'{path.relative_to(PACKAGE)}:{node.lineno}', text))
    return found


def reasons():
    """Return the reasons of the InputErrors in the package."""
    found = set()
    for path in PACKAGE.rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text())):
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Name)
                and node.func.id == 'InputError'
                and isinstance(node.args[0], ast.Constant)
            ):
                found.add(node.args[0].value)
    return found


@pytest.mark.parametrize('kind', family(LimitError))
@pytest.mark.parametrize('parameter', ['', 'geometry.stroke'])
def test_limit_error_has_value_limit_and_next_step(kind, parameter):
    error = kind('q1', 0.5, 0.4, 'm', 'above', parameter)
    source = f' ({parameter})' if parameter else ''
    assert str(error) == (
        f'q1 = 0.5 m is above the limit 0.4 m{source}; next: {kind.next_step}'
    )
    assert kind.next_step
    assert error.value == 0.5
    assert error.bound == 0.4
    assert error.unit == 'm'


@pytest.mark.parametrize('reason', sorted(reasons() | {'stopped'}))
def test_input_error_of_each_reason_has_one_next_step(reason):
    assert str(InputError(reason, 'wrong')).count(NEXT) == 1
    assert str(InputError(reason, f'wrong{NEXT}do this')) == f'wrong{NEXT}do this'


def test_each_reason_has_a_next_step_and_row():
    """Reasons that are no literals are states of the driver."""
    own = {'inactive', 'saturated', 'unit', 'mounting', 'exception'}
    assert reasons() - own <= {*InputError.INPUT_STEPS}
    page = (PACKAGE.parent / 'docs/operation.md').read_text()
    assert [reason for reason in reasons() if f'`{reason}`' not in page] == []


def parameter_errors():
    """Return the texts of the ParameterErrors in the package with their places."""
    found = []
    for path in sorted(PACKAGE.rglob('*.py')):
        for node in ast.walk(ast.parse(path.read_text())):
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Name)
                and node.func.id == 'ParameterError'
                and isinstance(node.args[0], (ast.JoinedStr, ast.Constant))
            ):
                place = f'{path.relative_to(PACKAGE)}:{node.lineno}'
                found.append((place, ast.unparse(node.args[0])))
    return found


def test_each_parameter_error_has_a_specific_next_step():
    """An error that contains another error has the next step of the other error."""
    inner = re.compile(r'\{(reason|error|str\(error\)|file_sentence\(error\))\}.$')
    errors = parameter_errors()
    assert len(errors) > 30
    for place, text in errors:
        assert 'next: ' in text or inner.search(text), place


def test_parameter_error_keeps_an_inner_next_step():
    inner = ParameterError('rate is wrong; next: set 100 Hz')
    outer = ParameterError(f'file rejected: {inner}')
    assert str(outer) == 'file rejected: rate is wrong; next: set 100 Hz'
    assert outer.problem == 'file rejected: rate is wrong'


def test_error_without_default_keeps_its_message():
    assert str(ManipulatorError('it failed')) == 'it failed'
    assert str(ManipulatorError()) == ''


def test_texts_have_one_next_step_and_no_doubled_word():
    assert [place for place, text in texts() if text.count('next: ') > 1] == []
    for place, text in texts():
        found = DOUBLED.search(text)
        assert found is None or found[1].isdigit(), place


def test_texts_name_a_limit_instead_of_a_bound():
    assert [one for one in texts() if re.search(r'bound \{', one[1])] == []


@pytest.mark.parametrize(
    ('reason', 'expected'),
    [
        ('far; next: a', 'home rejected: far; next: a'),
        ('home rejected: far; next: a', 'home rejected: far; next: a'),
        ('inactive; home failed: far; next: a', 'home failed: far; next: a'),
        ('home is not possible yet', 'home rejected: not possible yet'),
    ],
)
def test_attributed_reason_names_its_subject_once(reason, expected):
    assert attributed('home', 'rejected', reason) == expected


@pytest.mark.parametrize(
    'messages, expected',
    [
        (('halted',), 'halted'),
        (('halted; next: a', ''), 'halted; next: a'),
        (('halted; next: a', 'late; next: b'), 'halted; late; next: a, then b'),
        (('halted', 'late; next: b', 'two'), 'halted; late; two; next: b'),
        (('halted; next: a', 'late; next: a'), 'halted; late; next: a'),
        (('lost; next: a', 'late; next: a, then b'), 'lost; late; next: a, then b'),
        ((), ''),
    ],
)
def test_joined_messages_have_one_next_step(messages, expected):
    assert joined(*messages) == expected


@pytest.mark.parametrize('lateness', [0.0, -0.0, 1e-9, 4e-4, 6e-4, 0.05, 3.0])
def test_order_is_explained_without_a_zero_duration(lateness):
    message = str(InputError.out_of_order('imu', lateness))
    assert '0.000' not in message
    assert '-' not in message
    assert ('stamp of' in message) == (lateness < 5e-4)


@pytest.mark.parametrize(
    ('age', 'next_step'),
    [
        (0.4, 'synchronise the clocks, or reduce the load of the computer'),
        (1.8e9, 'stamp the message with the system time'),
    ],
)
def test_next_step_of_an_old_message_depends_on_its_age(age, next_step):
    with pytest.raises(InputError) as caught:
        require_recent('disturbance', age, 0.3, 0.01)
    assert caught.value.reason == 'stale'
    assert caught.value.remedy == next_step


def test_findings_of_a_drive_are_joined_once():
    findings = (
        'q1: 6065h differs; it has 2 bytes',
        'q1: 1016h is missing; next: replace q1',
    )
    error = DriveObjectError(*findings)
    assert error.findings == findings
    assert str(error) == (
        'q1: 6065h differs; it has 2 bytes; q1: 1016h is missing; next: replace q1'
    )


def test_full_file_system_has_a_next_step():
    """The error of a write contains no file name."""
    sentence = file_sentence(OSError(errno.ENOSPC, 'No space left on device'))
    assert sentence == 'writing failed: the file system is full; next: free some space'
    assert file_sentence(OSError(errno.EPIPE, 'Broken pipe')).endswith('Broken pipe')


@pytest.mark.parametrize('form', ['.6g', '.4g', '.3f', '.1f'])
@given(
    limit=st.floats(-1e6, 1e6, allow_subnormal=False),
    value=st.floats(-1e6, 1e6, allow_subnormal=False),
    steps=st.integers(-3, 3),
)
def test_value_and_limit_compare_alike_as_texts(form, limit, value, steps):
    if steps:  # a neighbour of the limit
        value = limit
        for _ in range(abs(steps)):
            value = math.nextafter(value, math.copysign(math.inf, steps))
    value_text, limit_text = map(float, compared(value, limit, form))
    if abs(value - limit) > 1e-12 or form.endswith('g'):
        assert (value_text > limit_text) == (value > limit)
        assert (value_text < limit_text) == (value < limit)


@pytest.mark.parametrize(
    ('value', 'limit', 'texts'),
    [
        (0.6, 0.5, ('0.6', '0.5')),
        (0.5 + 1e-9, 0.5, ('0.500000001', '0.5')),
        (0.1234569, 0.12345678, ('0.1234569', '0.1234568')),
        (0.0, 0.0, ('0', '0')),
        (math.nan, 0.5, ('nan', '0.5')),
        (math.inf, 0.5, ('inf', '0.5')),
    ],
)
def test_texts_have_only_the_digits_that_differ(value, limit, texts):
    assert compared(value, limit) == texts


ABOVE = 1.0 + 1e-9
LONGEST = parameter_fields(Geometry)['link_length'].maximum


@pytest.mark.parametrize(
    'reject',
    [
        lambda: Mechanism(Geometry()).certify(Pose(0.6, 0.25, 0.0)),
        lambda: Mechanism(Geometry()).certify(_beside_the_stroke()),
        lambda: Geometry(carriage_gap=0.02, carriage_length=0.02 * ABOVE),
        lambda: Geometry(carriage_gap=Geometry.platform_half_length),
        lambda: from_mapping(Geometry, {'link_length': LONGEST * ABOVE}),
        lambda: MotionLimits(acceleration=5.0 * ABOVE, jerk=5.0),
        lambda: require_recent('pose', 0.1 * ABOVE, 0.1, 0.1),
        lambda: require_recent('pose', -0.1 * ABOVE, 0.1, 0.1),
    ],
)
def test_message_about_a_limit_contains_no_equal_numbers(reject):
    with pytest.raises(ManipulatorError) as rejected:
        reject()
    value, limit = re.findall(r'(-?\d+(?:\.\d+)?) (?:m|s)\b', rejected.value.problem)[
        :2
    ]
    is_equal = 'not below' in rejected.value.problem
    assert (value == limit) == is_equal


def _beside_the_stroke():
    """Return a pose whose carriage q2 is 1 nm beyond the stroke."""
    carriages = Mechanism(Geometry()).inverse_kinematics(Pose(0.0, 0.25, 0.0))
    return Pose(Geometry().stroke[1] - carriages.q2 + 1e-9, 0.25, 0.0)
