"""
Count the source files, moves between files and calls that one setpoint passes on its way.

``python test/setpoint_path.py`` (`. .venv/environment` first) runs the nodes on simulated drives,
sends goals, and counts in four stages: the goal's callback, the tick that makes a setpoint of it,
the driver's callback, the cycle that sends it as an RPDO, without those that hold. Of each stage
the median invocation counts; a move is a call from one file of the package into another.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
import os
from pathlib import Path
import sys
import threading
import time

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE / 'helpers')]
os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

from can.interfaces.virtual import VirtualBus  # noqa: E402
from geometry_msgs.msg import PoseStamped  # noqa: E402
import rclpy  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.publisher import Publisher  # noqa: E402

PACKAGE = f'{HERE.parent}/facade_manipulator/'
DRIVES = f'{PACKAGE}drives/simulated'
CONTROL_THREAD = 'drive control'
SETPOINTS = 'joint_setpoints'
STAGES = ('goal', 'tick', 'driver', 'cycle')
RPDO = range(0x201, 0x280)
FOLLOWING = 'motion/limits.py'  # a cycle without it holds, and is on no setpoint's path
DEADLINE = 30.0
GOAL_PERIOD, GOALS = 0.5, 6


@dataclass
class Invocation:
    """What one invocation of a callback or of the loop's body passed."""

    files: set[str] = field(default_factory=set)
    moves: int = 0
    calls: int = 0


class Counter:
    """A profile function that counts the package's calls of one thread."""

    def __init__(self) -> None:
        self.now: Invocation | None = None

    def __call__(self, frame, event: str, _) -> None:
        code = frame.f_code
        if event != 'call' or self.now is None or not own(code) or code.co_name.startswith('<'):
            return
        self.now.calls += 1
        self.now.files.add(code.co_filename.removeprefix(PACKAGE))
        caller = frame.f_back.f_code if frame.f_back else None
        self.now.moves += bool(caller and own(caller)
                               and caller.co_filename != code.co_filename)


class LoopCounter(Counter):
    """Counts what the control thread does from one turn of its loop to the next."""

    def __init__(self, stages: dict[str, list[Invocation]]) -> None:
        super().__init__()
        self._stages = stages

    def sent(self, cob_id: int) -> None:
        """Note a frame on the bus: the last RPDO of a cycle ends an invocation."""
        if threading.current_thread().name == CONTROL_THREAD and cob_id in RPDO:
            if cob_id & 0x7F == 3:
                if self.now is not None and FOLLOWING in self.now.files:
                    self._stages['cycle'].append(self.now)
                self.now = Invocation()


def own(code) -> bool:
    return code.co_filename.startswith(PACKAGE) and not code.co_filename.startswith(DRIVES)


class Watch:
    """Wraps the nodes' callbacks so that those on a setpoint's way are counted."""

    def __init__(self) -> None:
        self.stages: dict[str, list[Invocation]] = {name: [] for name in STAGES}
        self.counter, self.loop = Counter(), LoopCounter(self.stages)
        self._published = False

    def install(self) -> None:
        """Put the counters between rclpy, python-can and the package."""
        threading.setprofile(self._profile_thread)
        create_subscription, create_timer = Node.create_subscription, Node.create_timer
        publish, send = Publisher.publish, VirtualBus.send
        stage_of = {'goal_pose': 'goal', SETPOINTS: 'driver'}

        def subscribe(node, kind, topic, callback, *args, **kwargs):
            return create_subscription(
                node, kind, topic, self._counted(callback, stage_of.get(topic)), *args, **kwargs)

        def tick(node, period, callback, *args, **kwargs):
            return create_timer(node, period, self._counted(callback, 'tick'), *args, **kwargs)

        def published(publisher, message):
            self._published |= publisher.topic.endswith(SETPOINTS)
            publish(publisher, message)

        def sent(bus, message, *args, **kwargs):
            self.loop.sent(message.arbitration_id)
            send(bus, message, *args, **kwargs)

        Node.create_subscription, Node.create_timer = subscribe, tick
        Publisher.publish, VirtualBus.send = published, sent

    def _profile_thread(self, frame, event, argument) -> None:
        is_loop = threading.current_thread().name == CONTROL_THREAD
        sys.setprofile(self.loop if is_loop else None)

    def _counted(self, callback: Callable, stage: str | None) -> Callable:
        def counted(*args):
            self.counter.now, self._published = Invocation(), False
            sys.setprofile(self.counter)
            try:
                return callback(*args)
            finally:
                sys.setprofile(None)
                if stage != 'tick' or self._published:
                    self.stages[stage].append(self.counter.now)

        return counted if stage else callback


def run() -> dict[str, list[Invocation]]:
    """Let the stack follow some goals; return what was counted."""
    watch = Watch()
    watch.install()
    from loop_bench import LoopThread

    from facade_manipulator.nodes.driver import DriverNode
    from facade_manipulator.nodes.manipulator import make_nodes

    rclpy.init(domain_id=os.getpid() % 100)
    driver = DriverNode(
        launch=LoopThread, parameter_overrides=[Parameter('simulate_drives', value=True)])
    executor, supervisor = SingleThreadedExecutor(), Node('supervisor')
    nodes = [driver, *make_nodes(), supervisor]
    for node in nodes:
        executor.add_node(node)
    for request in ('configure', 'home', 'activate'):
        job, end = driver._loop.request(request), time.monotonic() + DEADLINE
        while not job.done() and time.monotonic() < end:
            executor.spin_once(0.01)
        job.result(0.0)
    goals = supervisor.create_publisher(PoseStamped, 'goal_pose', 1)
    for number in range(GOALS):
        send_goal(goals, 0.05 * (-1) ** number, driver.get_clock().now().to_msg())
        end = time.monotonic() + GOAL_PERIOD
        while time.monotonic() < end:
            executor.spin_once(0.01)
    driver.close()
    rclpy.shutdown()
    return watch.stages


def send_goal(goals: Publisher, x: float, stamp) -> None:
    """Publish a goal on the wall."""
    goal = PoseStamped()
    goal.header.frame_id, goal.header.stamp = 'facade', stamp
    goal.pose.position.x, goal.pose.position.y = x, 0.26
    goals.publish(goal)


def median(invocations: list[Invocation]) -> Invocation:
    return sorted(invocations, key=lambda one: one.calls)[len(invocations) // 2]


def main() -> None:
    """Print the table and the files."""
    stages = {name: median(found) for name, found in run().items()}
    files = set().union(*(stage.files for stage in stages.values()))
    print(f'{"stage":10}{"files":>7}{"moves":>7}{"calls":>7}')
    for name, stage in stages.items():
        print(f'{name:10}{len(stage.files):7}{stage.moves:7}{stage.calls:7}')
    print(f'{"all":10}{len(files):7}{sum(one.moves for one in stages.values()):7}'
          f'{sum(one.calls for one in stages.values()):7}')
    print(*sorted(files), sep='\n')


if __name__ == '__main__':
    main()
