"""Replay a file of the black box and write a page about it."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from facade_manipulator.blackbox import CAN_TOPIC, read_recording, RecordedRun
from facade_manipulator.errors import above_zero, exit_status, RecordError
from facade_manipulator.files import atomic_write, write_table
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import by_stamp, pose_numbers, projected
from facade_manipulator.tools.replay.estimates import replay_estimates
from facade_manipulator.tools.replay.parameters import changed, ESTIMATOR
from facade_manipulator.tools.replay.poses import Comparison, replay_poses, replay_setpoints
from facade_manipulator.tools.replay.report import page
from facade_manipulator.tools.replay.stop import replay_stop

PAGE, CYCLES = 'replay.md', 'last_cycles.csv'
CAN_ERR_FLAG = 1 << 29  # linux/can.h
EXAMPLES = """
examples:
  replay blackbox_000007_20261122T083000Z.mcap
  replay blackbox_000007_20261122T083000Z.mcap --seconds 5 --output monday
  replay blackbox_000007_20261122T083000Z.mcap --set limits.acceleration=2
  replay blackbox_000007_20261122T083000Z.mcap --disturbance sway.csv
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    options = _options(arguments)
    action = (_write_disturbance if options.disturbance else
              _write_candump if options.candump else _replay)
    return exit_status('replay', lambda: action(options))


def _replay(options: argparse.Namespace) -> None:
    run = changed(read_recording(options.file), options.changes)
    estimates = _compare(replay_estimates, run) if ESTIMATOR in run.parameters else None
    poses = _compare(replay_poses, run)
    with_poses = poses if options.changes and len(poses.times) else None
    setpoints = _compare(lambda one: replay_setpoints(one, with_poses), run)
    print(f'simulated drives replay the last {options.seconds:g} s, as long as they took')
    stop = replay_stop(run, options.seconds, (options.changes and setpoints.setpoints) or None)
    options.output.mkdir(parents=True, exist_ok=True)
    text = page(options.file, run, poses, setpoints, stop, options.changes, estimates)
    for name, content in ((PAGE, text), *(
            (CYCLES, one.message.data) for one in run.topics['driver/last_cycles'][-1:])):
        with atomic_write(options.output / name) as draft:
            draft.write_text(content, encoding='utf-8')
    print(text)
    print(f'written in {options.output}/: {PAGE}')


def _compare(replay: Callable[[RecordedRun], Comparison], run: RecordedRun) -> Comparison:
    """Return a comparison, of nothing where the recording has not what it takes."""
    try:
        return replay(run)
    except RecordError as error:
        return Comparison.of([], run.begin, [str(error)])


def _write_disturbance(options: argparse.Namespace) -> None:
    """Write the recorded disturbance as a scenario's recording."""
    run, path = read_recording(options.file), options.disturbance
    estimates = run.topics['disturbance'] or run.topics['disturbance_odometry']
    rows = by_stamp((one.message for one in estimates), _place)
    if len(rows) < 2:
        raise RecordError('the recording has no disturbance')
    write_table(path, ('time', *Pose._fields), (
        (f'{time - rows[0][0]:.6f}', *pose) for time, *pose in rows))
    print(f'{len(rows)} estimates over {rows[-1][0] - rows[0][0]:.1f} s written to {path}: a '
          'scenario plays them with mission.motion recording')


def _write_candump(options: argparse.Namespace) -> None:
    """Write the recorded frames as `candump -L` does."""
    frames = [one.message for one in read_recording(options.file).topics[CAN_TOPIC.topic]]
    if not frames:
        raise RecordError('the recording has no CAN frames')
    with atomic_write(options.candump) as draft:
        draft.write_text('\n'.join(map(candump_line, frames)) + '\n', encoding='ascii')
    print(f'{len(frames)} frames written to {options.candump}')


def candump_line(frame: Any) -> str:
    """Return a frame as a line of a log that `canplayer` plays."""
    stamp = f'({frame.header.stamp.sec}.{frame.header.stamp.nanosec // 1000:06})'
    number = (f'{frame.id | CAN_ERR_FLAG:08X}' if frame.is_error else
              f'{frame.id:08X}' if frame.is_extended else f'{frame.id:03X}')
    data = 'R' if frame.is_rtr else bytes(frame.data[:frame.dlc]).hex().upper()
    return f'{stamp} can0 {number}#{data}'


def _place(message: Any) -> Pose:
    return projected(pose_numbers(message.pose.pose), 'disturbance')[0]


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='replay', epilog=EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Give what the black box recorded to the software of today, and compare.')
    parser.add_argument('file', type=Path, help='MCAP file of the recorder')
    parser.add_argument('--output', type=Path, default=Path('replay_report'), metavar='DIR',
                        help='folder of the page (default replay_report)')
    parser.add_argument('--seconds', type=above_zero, default=20.0, metavar='S',
                        help='how long before the stop the drives begin (default 20)')
    parser.add_argument('--set', dest='changes', action='append', default=[], metavar='NAME=VALUE',
                        help='replay with another parameter: would it have stopped?')
    parser.add_argument('--disturbance', type=Path, metavar='CSV',
                        help='write the recorded disturbance for a scenario, and nothing else')
    parser.add_argument('--candump', type=Path, metavar='LOG',
                        help='write the recorded CAN frames as candump -L, and nothing else')
    return parser.parse_args(arguments)


if __name__ == '__main__':
    raise SystemExit(main())
