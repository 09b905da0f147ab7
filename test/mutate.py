"""
Change the machine's code at random places, and see which changes the tests notice.

``python test/mutate.py --count 20 motion drives/controller`` makes 20 changes in each of these
packages (all of the machine without a name) and runs the tests that belong to it, those of
`make check` alone with ``--check``. Changed is what functions do; defaults are the user's, and
``--constants`` makes numbers with a name half as large again and, where no test notices, half as
large. What no test notices is printed, and each package's share at the end.
"""

from __future__ import annotations

import argparse
import ast
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
import os
from pathlib import Path
import random
import shutil
import subprocess
import sys
import tempfile
from typing import NamedTuple

TOP = Path(__file__).resolve().parents[1]
PACKAGE = 'facade_manipulator'
PLACES = ('kinematics', 'estimation', 'prediction', 'compensation', 'motion', 'drives/canopen',
          'drives/cia402', 'drives/controller', 'loop', 'blackbox', 'maintenance', 'ros', 'nodes')
BESIDE = {  # tests that belong to a package besides those of its own folder
    'drives/canopen': ('test/drives/cia402', 'test/drives/controller'),
    'drives/cia402': ('test/drives/controller',),
    'drives/controller': ('test/loop',), 'motion': ('test/drives/controller', 'test/loop'),
    'loop': ('test/tools/replay',), 'ros': ('test/test_interfaces.py', 'test/nodes'),
    'nodes': ('test/test_interfaces.py', 'test/test_diagnostics.py'),
}
# not `python -m pytest`, which would import what lies here, not the copy
PYTEST = str(Path(sys.executable).with_name('pytest'))
PATIENCE = 240.0  # s: a change that makes the tests hang is noticed, too
SWAPS: dict[type, type] = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn,
    ast.NotIn: ast.In, ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div,
    ast.Div: ast.Mult, ast.And: ast.Or, ast.Or: ast.And, ast.USub: ast.UAdd,
}
BY_CHECK = ('-m', 'not long and (quick or not (realtime or simulated))',
            '--hypothesis-profile=quick')
BY_ALL = '-m', 'not realtime', '--hypothesis-profile=quick'


class Change(NamedTuple):
    """One change of one file: what stands at some bytes of it, and what instead."""

    file: Path
    line: int
    start: int
    end: int
    old: str
    new: str

    def apply(self, tree: Path) -> None:
        """Make the change in a copy of the package."""
        source = (TOP / self.file).read_bytes()
        (tree / self.file).write_bytes(
            source[:self.start] + self.new.encode() + source[self.end:])

    def undo(self, tree: Path) -> None:
        """Take it back."""
        shutil.copy(TOP / self.file, tree / self.file)

    def __str__(self) -> str:
        return f'{self.file}:{self.line}: {self.old} -> {self.new}'


def changed(node: ast.AST) -> Iterator[ast.AST]:
    """Yield what a small mistake makes of an expression or a statement."""
    copy = deepcopy(node)
    if isinstance(copy, ast.Compare) and type(copy.ops[0]) in SWAPS:
        copy.ops[0] = SWAPS[type(copy.ops[0])]()
        yield copy
    elif isinstance(copy, (ast.BinOp, ast.UnaryOp, ast.BoolOp)) and type(copy.op) in SWAPS:
        copy.op = SWAPS[type(copy.op)]()
        yield copy
    elif isinstance(copy, ast.IfExp):
        copy.body, copy.orelse = copy.orelse, copy.body
        yield copy
    elif isinstance(copy, ast.Return) and ast.unparse(copy) not in ('return', 'return None'):
        yield ast.Return(ast.Constant(None))
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        yield ast.Constant(1.5 * node.value if node.value else 1)
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield ast.Constant(not node.value)


def changes_of(file: Path) -> list[list[Change]]:
    """Return every small mistake that can be made in what a file does, alone."""
    source = (TOP / file).read_text()
    return [[at(file, source, node, new)] for node in done(ast.parse(source))
            if isinstance(node, (ast.expr, ast.Return)) and not is_text(node)
            for new in changed(node)]


def done(module: ast.Module) -> Iterator[ast.AST]:
    """Yield what functions do: no defaults, no bounds of parameters, no named numbers."""
    functions = [node for node in ast.walk(module)
                 if isinstance(node, (ast.FunctionDef, ast.Lambda))]
    bodies = [node.body if isinstance(node.body, list) else [node.body] for node in functions]
    yield from dict.fromkeys(
        node for body in bodies for statement in body for node in ast.walk(statement))


def constants_of(file: Path) -> list[list[Change]]:
    """Return for each named number of a file: half as large again, half as large."""
    source = (TOP / file).read_text()
    numbers = [one for node in ast.parse(source).body
               if isinstance(node, (ast.Assign, ast.AnnAssign)) and node.value
               for one in ast.walk(node.value)
               if isinstance(one, ast.Constant) and isinstance(one.value, float) and one.value]
    return [[at(file, source, one, ast.Constant(factor * one.value)) for factor in (1.5, 0.5)]
            for one in numbers]


def is_text(node: ast.AST) -> bool:
    """Return whether a node is part of no arithmetic: a text or what makes one."""
    return isinstance(node, (ast.JoinedStr, ast.FormattedValue)) or (
        isinstance(node, ast.BinOp) and isinstance(node.left, (ast.JoinedStr, ast.Constant))
        and not isinstance(getattr(node.left, 'value', ''), (int, float)))


def at(file: Path, source: str, node: ast.expr | ast.Return, new: ast.AST) -> Change:
    """Return the change that puts an expression in a node's place."""
    starts = [0]
    for line in source.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    start = starts[node.lineno - 1] + node.col_offset
    end = starts[(node.end_lineno or node.lineno) - 1] + (node.end_col_offset or 0)
    text = ast.unparse(new)
    return Change(file, node.lineno, start, end, ast.unparse(node),
                  text if isinstance(node, ast.Return) else f'({text})')


def is_noticed(change: Change, tree: Path, place: str, selection: tuple[str, ...]) -> bool:
    """Run the tests of a package with a change made; return whether any fails."""
    change.apply(tree)
    try:
        return fails(tree, place, selection)
    finally:
        change.undo(tree)


def fails(tree: Path, place: str, selection: tuple[str, ...]) -> bool:
    """Return whether a test of a package fails, or takes for ever, with a copy of the package."""
    tests = [test for test in (f'test/{place}', *BESIDE.get(place, ())) if (TOP / test).exists()]
    try:
        return subprocess.run(
            [PYTEST, '-x', '-q', '-p', 'no:cacheprovider', *selection, *tests],
            cwd=TOP, env=os.environ | {'PYTHONPATH': str(tree), 'PYTHONDONTWRITEBYTECODE': '1'},
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=PATIENCE).returncode != 0
    except subprocess.TimeoutExpired:
        return True


def survivors(
    place: str, chosen: list[list[Change]], selection: tuple[str, ...], workers: int
) -> list[Change]:
    """Return the first of each row of changes of a package of which its tests notice none."""
    with tempfile.TemporaryDirectory() as folder:
        trees = [Path(folder, str(number)) for number in range(workers)]
        for tree in trees:
            shutil.copytree(TOP / PACKAGE, tree / PACKAGE,
                            ignore=shutil.ignore_patterns('__pycache__'))
            for data in ('package.xml', 'config', 'docs', 'launch', 'resource', 'README.md'):
                (tree / data).symlink_to(TOP / data)

        if fails(trees[0], place, selection):
            sys.exit(f'{place}: its tests fail though nothing is changed')

        def run(number: int) -> list[Change]:
            return [row[0] for row in chosen[number::workers]
                    if not any(is_noticed(one, trees[number], place, selection) for one in row)]

        with ThreadPoolExecutor(workers) as pool:
            return [change for part in pool.map(run, range(workers)) for change in part]


def main() -> int:
    """Print what no test notices and the share of each package."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('places', nargs='*', choices=[*PLACES, []], help='packages')
    parser.add_argument('--count', type=int, default=10,
                        help='changes of each package; of constants all are tried')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--constants', action='store_true')
    parser.add_argument('--check', action='store_true', help='with the tests of make check alone')
    parser.add_argument('--workers', type=int, default=os.cpu_count())
    options = parser.parse_args()
    choose, selection = random.Random(options.seed), BY_CHECK if options.check else BY_ALL
    find = constants_of if options.constants else changes_of
    for place in options.places or PLACES:
        possible = [row for file in sorted((TOP / PACKAGE / place).rglob('*.py'))
                    for row in find(file.relative_to(TOP))]
        count = len(possible) if options.constants else min(options.count, len(possible))
        chosen = choose.sample(possible, count)
        left = survivors(place, chosen, selection, options.workers)
        print(*left, sep='\n')
        print(f'{place}: {len(chosen) - len(left)} of {len(chosen)} noticed '
              f'({len(possible)} possible)\n', flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
