"""
Measure the value of each part and constant of the control: the ablation table of docs/results.md.

Each row replaces a part, or multiplies a constant, in a copy of the package, which `reference.py`
then measures.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
from tempfile import TemporaryDirectory

from reference import COLUMNS

from facade_manipulator.resources import PACKAGE

FACTORS = 0.5, 1.5
SCENARIOS = 'breeze', 'three_tones', 'gusts', 'burst', 'flips', 'storm', 'sensors', 'pressing 0.6'
# part: module, name in it, and the expression that replaces the original
PARTS = {
    'tones': ('prediction/tones.py', 'Tones.fit', 'lambda self, axis, variance: None'),
    'doubt about tones': (
        'prediction/continuation.py', 'Continuation.solve', 'lambda self, *arguments: ('
        'original(self, *arguments), setattr(self, "trust", np.ones_like(self.trust)))'),
    'jump detector': ('prediction/jumps.py', 'JumpDetector.evaluate',
                      'lambda self, *arguments: self._no_decision'),
    'prior': ('prediction/continuation.py', 'PRIOR_TIME', '1e-5 * original'),
    'weakening by growth': (
        'prediction/continuation.py', 'Continuation.weaken', 'lambda self, share: None'),
    'maximum acceleration': ('prediction/predictor.py', 'MAX_ACCELERATION', '1e3 * original'),
    'smoothing of the correction': ('compensation/correction.py', 'SMOOTHING', '1e-4'),
    'smoothing of the follower': (
        'motion/follower.py', 'SetpointFollower._smooth', 'lambda self, following: None')}
MULTIPLIED = (r'\1 = (lambda v: tuple(x * {0} for x in v) if isinstance(v, tuple) else '
              r'type(v)(v * {0}) if isinstance(v, int) else v * {0})(\2)')


def changes(modules: list[str]) -> Iterator[tuple[str, str, str]]:
    """Yield title, module and changed source of each row."""
    yield 'nothing', '__init__.py', ''
    for part, (module, name, replacement) in PARTS.items() if not modules else ():
        source = (PACKAGE / module).read_text()
        yield f'without {part}', module, (
            f'{source}\n{name} = (lambda original: {replacement})({name})\n')
    for module in modules:
        source = (PACKAGE / module).read_text()
        for name in re.findall(r'(?m)^([A-Z][A-Z_]+) = (?:np\.array\()?\(?-?\d', source):
            for factor in FACTORS:
                yield f'{module} {name} × {factor:g}', module, re.sub(
                    rf'(?m)^({name}) = ([^#\n]+)', MULTIPLIED.format(factor), source)


def measured(module: str, source: str, scenario: str, *options: str) -> str:
    """Return the row of the reference table, or the error of a copy that cannot run."""
    with TemporaryDirectory() as folder:
        shutil.copytree(PACKAGE, f'{folder}/{PACKAGE.name}')
        for name in ('config', 'package.xml'):
            Path(folder, name).symlink_to(PACKAGE.parent / name)
        Path(folder, PACKAGE.name, module).write_text(source)
        run = subprocess.run(
            [sys.executable, Path(__file__).with_name('reference.py'), '--seeds', '1',
             '--scenario', scenario, *options], capture_output=True, text=True, check=False,
            env=os.environ | {'PYTHONPATH': folder})
    return (run.stdout if run.returncode == 0 else run.stderr).splitlines()[-1]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description='Measure the value of each part and constant')
    parser.add_argument('--duration', default='45', help='s')
    parser.add_argument('--row', action='append', help='only this scenario; repeatable')
    parser.add_argument('--module', action='append', default=[],
                        help='vary the constants of this file, such as prediction/tones.py')
    options = parser.parse_args()
    print(f'| varied | scenario | {" | ".join(COLUMNS)} |\n|{"---|" * (len(COLUMNS) + 2)}')
    for title, module, source in changes(options.module):
        for row in options.row or SCENARIOS:
            print(f'| {title} {measured(module, source, row, "--duration", options.duration)}',
                  flush=True)


if __name__ == '__main__':
    main()
