"""`make bench`: performance of the package as ratios to competitors in the same run."""

import argparse
import json
import os
from pathlib import Path
import sys
import time

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')  # numpy reads it when it is imported
sys.path.append(str(Path(__file__).resolve().parents[1] / 'helpers'))
import kinematics  # noqa: E402
import prediction  # noqa: E402
import ros_nodes  # noqa: E402

SECTIONS = {section.__name__: section for section in (kinematics, prediction, ros_nodes)}
LINE = '{name:70} {ours:>9} {competitor:>10} {unit:5} {ratio:>6} {goal:>7} {met:>5}'


def main():
    """Run the sections, print the table and write bench.json."""
    parser = argparse.ArgumentParser(prog='make bench', description=__doc__)
    parser.add_argument('--quick', action='store_true', help='few and short rounds')
    parser.add_argument('--sections', nargs='+', choices=SECTIONS, default=list(SECTIONS))
    options = parser.parse_args()
    rows = []
    for name in options.sections:
        begin = time.monotonic()
        rows += SECTIONS[name].rows(options.quick)
        print(f'{name}: {time.monotonic() - begin:.0f} s', flush=True)
    print(LINE.format_map({key: key for key in rows[0]}))
    for row in rows:
        figures = {key: f'{row[key]:.4g}' for key in ('ours', 'competitor', 'ratio')}
        print(LINE.format_map(row | figures | {'met': 'yes' if row['met'] else 'NO'}))
    Path('bench_report').mkdir(exist_ok=True)
    Path('bench_report/bench.json').write_text(json.dumps(rows, indent=2) + '\n')


if __name__ == '__main__':
    main()
