"""
Measure the value of each part of the control: the ablation table of docs/results.md.

Each row replaces a part, and measures as `reference.py` does. A row can also multiply a constant
that only its own module uses.
"""

from __future__ import annotations

import argparse
from pkgutil import resolve_name
from unittest.mock import patch

import numpy as np
from reference import print_head, print_row

from facade_manipulator.prediction.jumps import JumpDecision

SCENARIOS = 'breeze', 'three_tones', 'gusts', 'burst', 'flips', 'storm', 'sensors', 'pressing 0.6'


def do_nothing(_):
    """Return a method that does nothing."""
    return lambda *_: None


def doubt_nothing(_):
    """Return a method that takes all estimates as true."""
    return lambda _, __, error, *___: JumpDecision(*np.zeros((2, len(error)), bool))


def trust_all(solve):
    """Return the method `solve` of a continuation that trusts all tones."""
    def solve_with_trust(self, *arguments):
        solve(self, *arguments)
        self.trust = np.ones_like(self.trust)
    return solve_with_trust


# title: place in the package, and a function that returns the replacement of the original
PARTS = {
    'nothing': ('compensation.correction.SMOOTHING', lambda original: original),
    'without tones': ('prediction.tones.Tones.fit', do_nothing),
    'without doubt about tones': ('prediction.continuation.Continuation.solve', trust_all),
    'without jump detector': ('prediction.jumps.JumpDetector.evaluate', doubt_nothing),
    'without prior': ('prediction.continuation.PRIOR_TIME', lambda value: 1e-5 * value),
    'without weakening by growth': ('prediction.continuation.Continuation.weaken', do_nothing),
    'without maximum acceleration': (
        'prediction.predictor.MAX_ACCELERATION', lambda value: 1e3 * value),
    'without smoothing of the correction': (
        'compensation.correction.SMOOTHING', lambda _: 1e-4),
    'without smoothing of the follower': ('motion.follower.SetpointFollower._smooth', do_nothing)}


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description='Measure the value of each part')
    parser.add_argument('--duration', type=float, default=45.0, help='s')
    parser.add_argument('--row', action='append', help='only this scenario; repeatable')
    options = parser.parse_args()
    print_head('varied', 'scenario')
    for title, (place, replace) in PARTS.items():
        owner, _, name = f'facade_manipulator.{place}'.rpartition('.')
        original = getattr(resolve_name(owner), name)
        with patch.object(resolve_name(owner), name, replace(original)):
            for row in options.row or SCENARIOS:
                print_row(title, row, seeds=1, duration=options.duration)


if __name__ == '__main__':
    main()
