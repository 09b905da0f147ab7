"""
`make bench`: everything that performance is judged by, beside what a competent user would write.

Prints one table and writes bench.json. Each ratio is a median of interleaved rounds.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
import sys
import time

sys.path.append(str(Path(__file__).resolve().parents[1] / 'helpers'))
import ros  # noqa: E402
import sections  # noqa: E402
import table  # noqa: E402

ROUNDS = {'quick': 3, 'full': 7}
SECTIONS = {
    'kinematics': sections.kinematics, 'prediction': sections.prediction, 'bus': sections.bus,
    'ros': ros.nodes,
}


def main() -> int:
    """Run the sections asked for; what fails costs its rows and the exit status."""
    parser = argparse.ArgumentParser(prog='make bench', description=__doc__)
    parser.add_argument('--quick', action='store_true', help='fewer rows and rounds')
    parser.add_argument('--sections', nargs='+', choices=SECTIONS, default=list(SECTIONS))
    parser.add_argument('--output', type=Path, default=Path('bench_report'))
    parser.add_argument('--before', type=Path, help='an earlier bench.json, to put beside')
    parser.add_argument('--can', default='virtual:bench', help='bus of the section bus')
    parser.add_argument('--can-rate', default='500', help='cycles per second on it')
    options = parser.parse_args()
    before = table.ratios(options.before) if options.before else {}
    os.environ |= {'BENCH_CAN': options.can, 'BENCH_CAN_RATE': options.can_rate}
    rounds = ROUNDS['quick' if options.quick else 'full']
    options.output.mkdir(parents=True, exist_ok=True)
    rows, failed = [], []
    for name in options.sections:
        begin = time.monotonic()
        try:
            found = SECTIONS[name](rounds, options.quick)
        except Exception as error:  # the other sections take minutes each
            print(f'{name} failed: {type(error).__name__}: {error}', file=sys.stderr)
            failed.append(name)
            continue
        print(f'{name}: {time.monotonic() - begin:.0f} s', flush=True)
        rows += found
        table.write(rows, options.output)
    table.show(rows, before)
    print(f'\n{table.write(rows, options.output)} written')
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
