"""`make bench`: performance of the package as ratios to competitors in the same run."""

import argparse
import json
import os
from pathlib import Path
import sys

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')  # numpy reads it when it is imported
sys.path.append(str(Path(__file__).resolve().parents[1] / 'helpers'))
import kinematics  # noqa: E402
import lateness  # noqa: E402
import prediction  # noqa: E402
import ros_nodes  # noqa: E402

SECTIONS = {
    section.__name__: section
    for section in (kinematics, prediction, ros_nodes, lateness)
}
LINE = (
    '{name:70} {ours:9.4g} beside {competitor:9.4g} {unit:5} ratio {ratio:6.3g} (goal {goal}, '
    'met: {met})'
)


def main():
    """Run the sections, print each row and write bench.json."""
    parser = argparse.ArgumentParser(prog='make bench', description=__doc__)
    parser.add_argument('--quick', action='store_true', help='few and short rounds')
    parser.add_argument(
        '--sections', nargs='+', choices=SECTIONS, default=list(SECTIONS)
    )
    options = parser.parse_args()
    rows = []
    for name in options.sections:
        for row in SECTIONS[name].rows(options.quick):
            print(LINE.format_map(row), flush=True)
            rows.append(row)
    Path('bench_report').mkdir(exist_ok=True)
    Path('bench_report/bench.json').write_text(json.dumps(rows, indent=2) + '\n')


if __name__ == '__main__':
    main()
