"""Watch a manipulator, or all there are, in the terminal: the monitor and the demo's view."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
import math
import re
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.utilities import remove_ros_args
from rich.box import SIMPLE_HEAD
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text
from sensor_msgs.msg import JointState

from facade_manipulator import interfaces, ros
from facade_manipulator.interfaces import Topic
from facade_manipulator.messages import readable_pose
from facade_manipulator.nodes.overview import Overview, overview, POSES, Seen, Words
from facade_manipulator.nodes.overview import Table as TableOfWords

REFRESH_PERIOD = 0.25  # s
LINE_PERIOD = 5.0  # s between lines where a screen cannot be written again
NARROW = 70  # columns below which a table shows the first of its columns alone
STYLES = {'ok': 'green', 'warn': 'yellow', 'error': 'bold red', 'stale': 'bold magenta'}


class Observer:
    """
    Keep the newest of everything a person wants to see, by subscriptions of a client's node.

    The client's `spin` keeps them going; of what came since only the newest is taken. It is the
    client's manipulator, or that of another namespace.
    """

    def __init__(self, client: ros.ManipulatorClient, namespace: str | None = None) -> None:
        self.seen = Seen(client.namespace if namespace is None else namespace, client.gondolas)
        receivers: dict[Topic, Callable[[float, Any], None]] = {
            **{topic: partial(self._receive_pose, topic) for topic in POSES},
            interfaces.GOAL_STATUS: self._receive_goal,
            interfaces.JOINT_STATES: self._receive_joints}
        for topic, receive in receivers.items():
            name = f'/{self.seen.namespace}/{topic.name}'.replace('//', '/')
            client.subscribe(topic._replace(name=name), receive, depth=1)

    def overview(self) -> Overview:
        """Return what is to be seen at this moment."""
        return overview(self.seen, time.monotonic())

    def _receive_pose(self, topic: Topic, came: float, message: PoseStamped) -> None:
        self.seen.poses[topic] = came, readable_pose(message)

    def _receive_goal(self, _: float, status: DiagnosticStatus) -> None:
        # a goal stays until another is followed
        self.seen.poses[interfaces.GOAL_STATUS] = math.inf, ros.followed_goal(status)

    def _receive_joints(self, came: float, message: JointState) -> None:
        self.seen.joints = came, message


@contextmanager
def screen(console: Console) -> Iterator[Callable[[Overview, str], None]]:
    """Lend what shows an overview and a remark: again in its place, or else now and then."""
    if not console.is_terminal or console.is_dumb_terminal:
        yield _Lines(console).show
        return
    with Live(console=console, auto_refresh=False) as live:
        yield lambda view, remark: live.update(
            render(view, remark, console.width), refresh=True)


class _Lines:
    """Print everything whenever something is the matter, and a line of poses now and then."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._printed: tuple[str, ...] = ()
        self._due = -math.inf

    def show(self, view: Overview, remark: str) -> None:
        now = time.monotonic()
        # another figure in the same message is no news
        matters = tuple(re.sub(r'[\d.]+', '', words.text) for words in (
            view.title, *view.troubles))
        if matters != self._printed:
            self._console.print(render(view, remark, self._console.width))
        elif now >= self._due:
            poses = view.tables[0]
            self._console.print('; '.join([
                remark, ' '.join(head.removeprefix('>') for head in poses.heads),
                *(' '.join(cell.text for cell in row) for row in poses.rows)]))
        else:
            return
        self._printed, self._due = matters, now + LINE_PERIOD


def render(view: Overview, remark: str, width: int) -> Group:
    """Return the view; without troubles it fits a terminal of 80 by 24."""
    return Group(
        Text.assemble(_text(view.title), '   ', remark), *map(_text, view.troubles),
        *(_table(table, width) for table in view.tables),
        Text())  # an empty line: the terminal writes ^C where the view ends, and may break there


def _text(words: Words) -> Text:
    return Text(words.text, style=STYLES[words.level])


def _table(table: TableOfWords, width: int) -> Table:
    shown = table.narrow if width < NARROW else len(table.heads)
    drawn = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_edge=False)
    for head in table.heads[:shown]:  # Text: a unit in brackets would be taken for markup
        drawn.add_column(Text(head.removeprefix('>')), overflow='fold',
                         justify='right' if head.startswith('>') else 'left')
    for row in table.rows:
        drawn.add_row(*map(_text, row[:shown]))
    return drawn


def main(args: list[str] | None = None) -> int:
    """Watch a manipulator until Ctrl-C."""
    words = remove_ros_args(args=sys.argv if args is None else ['monitor', *args])[1:]
    parser = argparse.ArgumentParser(
        prog='monitor', description='Watch a manipulator in the terminal until Ctrl-C.')
    parser.add_argument('--namespace', default='',
                        help="of the manipulator's nodes; without it a line for each gondola")
    options = parser.parse_args(words)
    try:
        rclpy.init(args=args)
        with ros.ManipulatorClient(options.namespace, 'monitor') as client:
            _watch(client)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    finally:
        rclpy.try_shutdown()
    return 0


def _watch(client: ros.ManipulatorClient) -> None:
    observer = Observer(client)
    with screen(Console()) as show:
        while rclpy.ok():
            client.spin(REFRESH_PERIOD)
            show(observer.overview(), '(Ctrl-C ends the view, not the machine)')


if __name__ == '__main__':
    raise SystemExit(main())
