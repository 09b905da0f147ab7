"""
Supervisor of one manipulator with rclpy only: strokes along the wall.

    python supervisor_with_rclpy.py --strokes 10 --pressing --ros-args -r __ns:=/gondola_1

Nothing enables itself: each request that follows a next step, also at the start, waits for the
operator to read the message, to apply the remedy and to press Enter. Keep this confirmation in
your program. Park the carriages at their marks before each `home`, and keep people away from the
machine. Ctrl-C deactivates the drives. After a crash of this program or of a node, start it
again: the supervisor continues with the present next step.
"""

from argparse import ArgumentParser
from functools import partial
import math
from select import select
import sys
import time

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

# with pressing: goals behind the face of the wall, by less than contact.retreat
STROKES = ((-0.1, 0.22), (0.1, 0.22))  # m
PARKED = (0.0, 0.14)  # m, head in, near the rail
GOAL_TIMEOUT = 60.0  # s
REQUEST_TIMEOUT = 120.0  # s: homing takes longest; a lost request has no answer
SILENCE = 2.0  # s without driver/status, after which the driver counts as silent
TRANSITIONS = ('cleanup', 'configure', 'activate', 'deactivate')
SILENT = {
    'message': 'driver/status is silent',
    'next step': 'check whether the driver still runs',
    'power': 'unknown',
}
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Failure(Exception):
    """A request or a goal failed; the message is that of the node."""


class Supervisor(Node):
    """Strokes of one manipulator, continued after faults that the operator has remedied."""

    def __init__(self) -> None:
        super().__init__('supervisor')
        self.permitted_at = -math.inf
        self.received = {name: (-math.inf, {}) for name in ('driver', 'goal')}
        for name, topic in (
            ('driver', 'driver/status'),
            ('goal', 'compensator/goal_status'),
        ):
            receive = partial(self.receive, name)
            self.create_subscription(DiagnosticStatus, topic, receive, LATCHED)
        self.goals = self.create_publisher(PoseStamped, 'goal_pose', LATCHED)
        self.software_stop = self.create_publisher(Bool, 'software_stop', 10)
        self.transition = self.create_client(ChangeState, 'driver/change_state')
        self.triggers = {
            name: self.create_client(Trigger, f'driver/{name}')
            for name in ('home', 'clear_faults')
        }
        self.parameters = AsyncParameterClient(self, 'compensator')

    def receive(self, name: str, status: DiagnosticStatus) -> None:
        """Keep the values of a message."""
        values = {item.key: item.value for item in status.values}
        values['message'] = status.message
        self.received[name] = time.monotonic(), values

    def driver(self) -> dict[str, str]:
        """Return the newest values of driver/status."""
        received_at, values = self.received['driver']
        if time.monotonic() - received_at > SILENCE:
            return SILENT
        return values

    def wait_until(self, condition, what: str, timeout: float) -> None:
        """Receive messages and publish software_stop until a condition is true."""
        end = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > end:
                raise Failure(f'timed out after {timeout:g} s waiting for {what}')
            if time.monotonic() - self.permitted_at >= 0.1:
                self.permitted_at = time.monotonic()
                self.software_stop.publish(Bool(data=False))
            rclpy.spin_once(self, timeout_sec=0.02)

    def pause(self) -> None:
        """Wait until driver/status reports a fault, or the state after a request."""
        end = time.monotonic() + 1.0
        self.wait_until(lambda: time.monotonic() > end, 'driver/status', 2.0)

    def ask(self, question: str) -> None:
        """Wait until the operator presses Enter, and continue to publish software_stop."""
        print(f'{question}, then press Enter', flush=True)
        self.wait_until(
            lambda: select([sys.stdin], [], [], 0.0)[0], 'the operator', math.inf
        )
        if not sys.stdin.readline():
            raise KeyboardInterrupt  # the terminal is closed

    def make_ready(self) -> None:
        """Follow the next steps until the drives follow goals."""
        self.pause()
        while self.driver()['next step']:
            try:
                self.follow_next_step()
            except Failure as failure:
                print(failure)
            self.pause()

    def follow_next_step(self) -> None:
        """Call the requests of the next step that the operator has read and confirmed."""
        driver = self.driver()
        print(f'{driver["message"]}; power {driver["power"]}')
        self.ask('Remove the cause and park the carriages before home')
        if self.driver()['next step'] != driver['next step']:
            return  # the remedy or a further fault changed it: show the new message first
        for name in driver['next step'].rpartition('then ')[2].split(', '):
            if name in TRANSITIONS or name in self.triggers:
                print(name, flush=True)
                self.request(name)

    def request(self, name: str) -> None:
        """Call one request of the driver; raises a Failure if the driver rejects it."""
        if name in self.triggers:
            answer = self.triggers[name].call_async(Trigger.Request())
        else:
            message = ChangeState.Request(transition=Transition(label=name))
            answer = self.transition.call_async(message)

        self.wait_until(
            lambda: answer.done() or self.driver() is SILENT, name, REQUEST_TIMEOUT
        )
        if not answer.done() or not answer.result().success:
            raise Failure(f'{name} rejected: {self.driver()["message"]}')

    def move(self, x: float, y: float, is_pressing: bool) -> None:
        """Move the head to a goal; after a fault, send the goal again."""
        while True:
            try:
                self.press(is_pressing)  # also after a restart of the compensator
                return self.go_to(x, y)
            except Failure as failure:
                print(failure)
            self.make_ready()
            self.ask('The head moves to its goal again: clear the machine')

    def press(self, is_enabled: bool) -> None:
        """Switch pressing on or off; the compensator presses from its next goal on."""
        value = Parameter('contact.enabled', value=is_enabled)
        answer = self.parameters.set_parameters([value])
        self.wait_until(answer.done, 'contact.enabled of the compensator', 10.0)
        (result,) = answer.result().results
        if not result.successful:
            raise Failure(f'contact.enabled rejected: {result.reason}')

    def go_to(self, x: float, y: float) -> None:
        """Publish a goal until the compensator reports it, and wait until it is reached."""
        goal = PoseStamped()
        goal.header.frame_id = f'{self.get_namespace()}/facade'.lstrip('/')
        goal.header.stamp = self.get_clock().now().to_msg()
        goal.pose.position.x, goal.pose.position.y = x, y
        stamp = f'{goal.header.stamp.sec}.{goal.header.stamp.nanosec:09d}'

        def is_reported() -> bool:
            self.goals.publish(goal)  # repeat: discovery of a subscriber may be late
            values = self.received['goal'][1]
            return stamp in (
                values.get('goal stamp'),
                values.get('rejected goal stamp'),
            )

        def is_reached() -> bool:
            values = self.received['goal'][1]
            if values.get('rejected goal stamp') == stamp:
                raise Failure(values['rejection'])
            if values['state'] in ('ended', 'superseded'):
                raise Failure(values['message'])
            return values['state'] == 'reached'

        self.wait_until(is_reported, 'a compensator to report the goal', 10.0)
        self.wait_until(is_reached, 'the goal', GOAL_TIMEOUT)

    def run(self, strokes: int, is_pressing: bool) -> None:
        """Make the strokes, move the head in, and leave the drives without power."""
        self.make_ready()
        for number in range(strokes):
            self.move(*STROKES[number % 2], is_pressing)
            print(f'stroke {number + 1} of {strokes}', flush=True)
        self.move(*PARKED, is_pressing=False)

    def end(self) -> None:
        """Leave the drives without power and the bus closed."""
        for name in ('deactivate', 'cleanup'):
            try:
                self.request(name)
            except (
                Failure
            ) as failure:  # the drives have no power already, or are silent
                print(failure)


def main() -> None:
    """Run the supervisor; Ctrl-C deactivates the drives."""
    parser = ArgumentParser()
    parser.add_argument('--strokes', type=int, default=10)
    parser.add_argument('--pressing', action='store_true')
    options = parser.parse_args(remove_ros_args(sys.argv)[1:])
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    supervisor = Supervisor()
    try:
        supervisor.run(options.strokes, options.pressing)
    except KeyboardInterrupt:
        print('interrupted')
    finally:
        supervisor.end()
        rclpy.shutdown()


if __name__ == '__main__':
    main()
