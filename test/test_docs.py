"""README and docs/, compared with the code: tables, examples, commands, files, links."""

import ast
from importlib import import_module
from pathlib import Path
import re
from textwrap import dedent

import pytest

import facade_manipulator
from facade_manipulator import command_line, executables, topics
from facade_manipulator.compensation.correction import CorrectionMode
from facade_manipulator.compensation.held_back import HeldBack
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.errors import LimitError
from facade_manipulator.nodes import run
from facade_manipulator.study.figures import FIGURES

ROOT = Path(facade_manipulator.__file__).parents[1]

if not (ROOT / 'docs').is_dir():
    pytest.skip('the documents exist only in the source tree', allow_module_level=True)
FILES = [ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md'))]
TEXTS = {path.relative_to(ROOT).as_posix(): path.read_text() for path in FILES}
INTERFACES = TEXTS['docs/reference.md']
BLOCK = re.compile(r'^ *```(\w*)\n(.*?)^ *```', re.DOTALL | re.MULTILINE)
BLOCKS = []  # page, kind and content
COMMANDS = []
for page, page_text in TEXTS.items():
    for block_kind, content in BLOCK.findall(page_text):
        BLOCKS.append((page, block_kind, content))
        if not block_kind:
            COMMANDS += content.replace('\\\n', ' ').splitlines()
    for inline in re.findall('`((?:make|ros2|python) [^`]+)`', page_text):
        COMMANDS += inline.replace('\\\n', ' ').splitlines()
EXAMPLES = []
for number, (page, block_kind, content) in enumerate(BLOCKS):
    if block_kind == 'python':
        EXAMPLES.append(pytest.param(dedent(content), id=f'{page}-{number}'))
SETUP = (ROOT / 'setup.py').read_text()
EXECUTABLES = set(
    re.findall(r"'(\w+)'", re.search(r'EXECUTABLES = \(([^)]*)\)', SETUP).group(1))
)


def rows(head: str, text: str = INTERFACES) -> list[list[str]]:
    """Return the cells of the table whose head begins with a text."""
    body = re.search(rf'\n\| {head} .*\n\|[-|]+\n((?:\|.*\n)+)', text).group(1)
    lines = [line.strip('|') for line in body.splitlines()]
    return [[*map(str.strip, line.split(' | '))] for line in lines]


def names(cell: str) -> list[str]:
    """Return the names in code font, at least one."""
    found = re.findall('`([^`]+)`', cell)
    assert found, cell
    return found


def named(pattern: str) -> set[str]:
    """Return the matches of a pattern's group in all commands, at least one."""
    found = set()
    for line in COMMANDS:
        found.update(re.findall(pattern, line))
    assert found, pattern
    return found


def test_commands_name_topics_and_services_with_their_types():
    known = {}
    for one in vars(topics).values():
        if isinstance(one, (topics.Topic, topics.Service)):
            known[f'/{one.name.lstrip("/")}'] = (
                f'{one.type.__module__.split(".")[0]}/{one.type.__name__}'
            )
    told = named(r'ros2 (?:topic pub|service call) (?:--\w+ \d+ )*(/\S+ +[\w/]+)')
    for command in told:
        name, kind = command.split()
        # operation.md: variable of the shell with the namespace
        name = name.replace('${N}', '')
        assert known[name] == re.sub('/(msg|srv)/', '/', kind), command


def test_executables_in_commands_are_documented():
    documented = set()
    for row in rows('executable'):
        documented.update(names(row[0]))
    assert documented >= EXECUTABLES - {'compensator', 'ik_service'}
    assert documented | named(r'ros2 run facade_manipulator (\w+)') <= EXECUTABLES


def test_exit_statuses_of_all_executables_are_documented():
    documented = [int(row[0]) for row in rows('status')]
    assert documented == [
        0,
        run.FAILED,
        run.USAGE_ERROR,
        executables.INTERRUPTED,
        command_line.BROKEN_PIPE,
    ]
    assert executables.CANNOT_START == run.USAGE_ERROR


def test_targets_and_scripts_in_commands_exist():
    makefile = (ROOT / 'Makefile').read_text()
    targets = set(re.findall(r'^([a-z-]+):', makefile, re.MULTILINE))
    assert named(r'\bmake ([a-z][a-z-]*)') - {'TARGET'} <= targets
    for file in named(r'python (test/[\w./]+\.py)'):
        assert (ROOT / file).exists(), file


@pytest.mark.parametrize('example', EXAMPLES)
def test_python_example_imports_and_runs_without_ros(example):
    for node in ast.walk(ast.parse(example)):
        if isinstance(node, ast.ImportFrom):
            module = import_module(node.module)
            assert all(hasattr(module, alias.name) for alias in node.names)
    if 'rclpy' not in example:
        exec(compile(example, 'example', 'exec'), {})


@pytest.mark.parametrize('name', TEXTS)
def test_files_named_on_each_page_exist(name):
    text = TEXTS[name]
    linked = [
        (ROOT / name).parent / link for link in re.findall(r'\]\(([^)#:]+)\)', text)
    ]
    told = [
        ROOT / file
        for file in re.findall(r'`((?:config|launch|test|docs)/[\w./]+)`', text)
    ]
    assert not [path for path in (*linked, *told) if not path.exists()]


def test_paper_page_shows_every_figure_of_the_study():
    shown = re.findall(r'resource/paper/([^)]+)', TEXTS['docs/paper.md'])
    stored = [path.name for path in (ROOT / 'resource/paper').iterdir()]
    assert sorted(shown) == sorted(stored) == sorted(FIGURES), (
        'next: copy the figure to resource/paper and show it in docs/paper.md'
    )


def test_operation_page_explains_each_reason():
    package = Path(facade_manipulator.__file__).parent
    rejections = set()
    for path in package.rglob('*.py'):
        rejections.update(re.findall(r"InputError\(\s*'(\w+)'", path.read_text()))
    limits = {kind.reason for kind in LimitError.__subclasses__()}
    states = {state.value for state in ControllerState} - {'active'}
    modes = {mode.value for mode in CorrectionMode} - {'compensating'}
    assert rejections
    page = re.sub('```.*?```', '', TEXTS['docs/operation.md'], flags=re.DOTALL)
    explained = set(re.findall('`([^`]+)`', page))
    assert rejections | limits | states | modes | {*HeldBack.HOLDS} <= explained
