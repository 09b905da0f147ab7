"""
Measure the value of each part and constant of the control: the ablation table of docs/results.md.

Each row switches a part off, or multiplies a constant in the source of its module. It then runs
the closed loop in a process that has not imported the package before.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
import importlib
from importlib.machinery import SourceFileLoader
from multiprocessing import get_context
from pathlib import Path
import re
from typing import Any

import numpy as np

PACKAGE = 'facade_manipulator'
FACTORS = 0.5, 1.5
ROWS = ('breeze', 'three_tones', 'gusts', 'burst', 'flips', 'storm', 'sensors', 'pressing 0.6')
MODULES = (*(f'prediction.{name}' for name in (
    'jumps', 'tones', 'filters', 'prior', 'continuation', 'predictor')),
    'compensation.correction', 'motion.limits')


def trusting(solve: Callable[..., None]) -> Callable[..., None]:
    """Return `Continuation.solve` with full trust in the tones."""
    def changed(self: Any, *arguments: Any) -> None:
        solve(self, *arguments)
        self.trust = np.ones_like(self.trust)
    return changed


# part: module, name in it, and the replacement as a function of the original
PARTS: dict[str, tuple[str, str, Callable[[Any], Any]]] = {
    'tones': ('prediction.tones', 'Tones.fit', lambda _: lambda self, axis, variance: None),
    'doubt about tones': ('prediction.continuation', 'Continuation.solve', trusting),
    'jump detector': ('prediction.jumps', 'JumpDetector.evaluate',
                      lambda _: lambda self, *arguments: self._no_decision),
    'prior': ('prediction.continuation', 'PRIOR_TIME', lambda time: 1e-5 * time),
    'weakening by growth': ('prediction.continuation', 'Continuation.weaken',
                            lambda _: lambda self, share: None),
    'maximum acceleration': ('prediction.predictor', 'MAX_ACCELERATION', lambda most: 1e3 * most),
    'smoothing of the correction': ('compensation.correction', 'SMOOTHING', lambda _: 1e-4),
    'smoothing of the follower': ('motion.follower', 'SetpointFollower._smooth',
                                  lambda _: lambda self, following: None)}


def switch_off(part: str) -> None:
    """Replace a part; raise an AttributeError if the control no longer has it."""
    module, name, change = PARTS[part]
    *path, last = name.split('.')
    owner: Any = importlib.import_module(f'{PACKAGE}.{module}')
    for step in path:
        owner = getattr(owner, step)
    setattr(owner, last, change(getattr(owner, last)))


def sources() -> Path:
    """Return the folder of the package."""
    return Path(importlib.util.find_spec(PACKAGE).submodule_search_locations[0])


def constants(module: str) -> list[str]:
    """Return the names of the numeric constants of a module."""
    text = (sources() / f'{module.replace(".", "/")}.py').read_text()
    return re.findall(r'^([A-Z][A-Z_]+) = (?:np\.array\()?\(?-?\d', text, re.MULTILINE)


def multiply(module: str, constant: str, factor: float) -> None:
    """Multiply a constant in the source of a module that is not imported yet."""
    file = str(sources() / f'{module.replace(".", "/")}.py')
    read, stats = SourceFileLoader.get_data, SourceFileLoader.path_stats

    def get_data(self: SourceFileLoader, path: str) -> bytes:
        text = read(self, path)
        return text if path != file else re.sub(
            rb'(?m)^%b = ([^#\n]+)' % constant.encode(), (
                rb'%b = (lambda v: tuple(x * %g for x in v) if isinstance(v, tuple)'
                rb' else type(v)(v * %g) if isinstance(v, int) else v * %g)(\1)'
            ) % (constant.encode(), factor, factor, factor), text)

    def path_stats(self: SourceFileLoader, path: str) -> Any:
        if path == file:
            raise OSError  # without it, cached bytecode would be loaded
        return stats(self, path)

    SourceFileLoader.get_data, SourceFileLoader.path_stats = get_data, path_stats


def measured(change: tuple[Any, ...], row: str, seed: int, duration: float) -> str:
    """Return RMS errors, peaks, jerk and force, limited cycles, rejections, shares in 2 σ."""
    try:
        if change:
            (switch_off if len(change) == 1 else multiply)(*change)
        from reference import measure
        _, rms, peaks, jerk, inside, (limited,), (rejected,), force, *_ = measure(
            row, seed, duration)
    except Exception as error:  # a variation may break anything
        return f'{type(error).__name__}: {error}'[:60]
    rms, peaks, jerk, inside = (' / '.join(f'{value:.3g}' for value in values)
                                for values in (rms, peaks, jerk + force, inside))
    return f'{rms}; peak {peaks}; jerk {jerk}; {limited}+{rejected}; {inside} %'


def changes(modules: list[str] | None) -> Iterator[tuple[str, tuple[Any, ...]]]:
    """Yield title and change of each row."""
    yield 'nothing', ()
    for part in PARTS if not modules else ():
        yield f'without {part}', (part,)
    for module in modules or ():
        for constant in constants(module):
            for factor in FACTORS:
                yield f'{module}.{constant} × {factor:g}', (module, constant, factor)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description='Measure the value of each part and constant')
    parser.add_argument('--duration', type=float, default=45.0, help='s')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--row', action='append', help='only this row; repeatable')
    parser.add_argument('--module', action='append', choices=MODULES,
                        help='vary the constants of this module instead of the parts; repeatable')
    options = parser.parse_args()
    rows = options.row or ROWS
    print(f'| varied | {" | ".join(rows)} |\n|{"---|" * (len(rows) + 1)}')
    for title, change in changes(options.module):
        with get_context('fork').Pool(1, maxtasksperchild=1) as pool:
            cells = pool.starmap(
                measured, [(change, row, options.seed, options.duration) for row in rows], 1)
        print(f'| {title} | {" | ".join(cells)} |', flush=True)


if __name__ == '__main__':
    main()
