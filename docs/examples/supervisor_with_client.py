"""
Supervisor of one manipulator with the client of the package: strokes along the wall.

    python supervisor_with_client.py --namespace gondola_1 --strokes 10 --pressing

Nothing enables itself: each request that follows a next step, also at the start, waits for the
operator to read the message, to apply the remedy and to press Enter. Keep this confirmation in
your program. Park the carriages at their marks before each `home`, and keep people away from the
machine. Ctrl-C deactivates the drives. After a crash of this program or of a node, start it
again: the supervisor continues with the present next step.
"""

from argparse import ArgumentParser
import math
from select import select
import sys
import time

import rclpy
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Bool

from facade_manipulator import topics
from facade_manipulator.client import GoalNotReachedError, ManipulatorClient
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Pose

# with pressing: goals behind the face of the wall, by less than contact.retreat
STROKES = (Pose(-0.1, 0.22, 0.0), Pose(0.1, 0.22, 0.0))
PARKED = Pose(0.0, 0.14, 0.0)  # head in, near the rail
GOAL_TIMEOUT = 60.0  # s


class Supervisor:
    """Strokes of one manipulator, continued after faults that the operator has remedied."""

    def __init__(self, namespace: str) -> None:
        self.manipulator = ManipulatorClient(namespace, check=self.permit_power)
        node = self.manipulator.node
        self.software_stop = node.create_publisher(*topics.SOFTWARE_STOP)
        self.parameters = AsyncParameterClient(node, 'compensator')
        self.permitted_at = -math.inf
        self.requests = {
            'cleanup': self.manipulator.cleanup,
            'configure': self.manipulator.configure,
            'home': lambda: self.manipulator.home(again=True),
            'clear_faults': self.manipulator.clear_faults,
            'activate': self.manipulator.activate,
        }

    def permit_power(self) -> None:
        """Publish software_stop ten times a second: the client calls this while it waits."""
        now = time.monotonic()
        if now - self.permitted_at >= 0.1:
            self.permitted_at = now
            self.software_stop.publish(Bool(data=False))

    def ask(self, question: str) -> None:
        """Wait until the operator presses Enter, and continue to publish software_stop."""
        print(f'{question}, then press Enter', flush=True)
        self.manipulator.wait_until(
            lambda: select([sys.stdin], [], [], 0.0)[0], 'the operator', math.inf
        )
        if not sys.stdin.readline():
            raise KeyboardInterrupt  # the terminal is closed

    def pause(self) -> None:
        """Wait until driver/status reports a fault, or the state after a request."""
        end = time.monotonic() + 1.0
        self.manipulator.wait_until(lambda: time.monotonic() > end, 'driver/status')

    def make_ready(self) -> None:
        """Follow the next steps until the drives follow goals."""
        self.pause()
        while self.manipulator.status.next_step:
            try:
                self.follow_next_step()
            except ManipulatorError as error:
                print(error)
            self.pause()

    def follow_next_step(self) -> None:
        """Call the requests of the next step that the operator has read and confirmed."""
        status = self.manipulator.status
        print(f'{status.message}; power {status.power}')
        self.ask('Remove the cause and park the carriages before home')
        if self.manipulator.status.next_step != status.next_step:
            return  # the remedy or a further fault changed it: show the new message first
        for name in status.next_step.rpartition('then ')[2].split(', '):
            if name in self.requests:
                print(name, flush=True)
                self.requests[name]()

    def press(self, is_enabled: bool) -> None:
        """Switch pressing on or off; the compensator presses from its next goal on."""
        value = Parameter('contact.enabled', value=is_enabled)
        answer = self.parameters.set_parameters([value])
        self.manipulator.wait_until(answer.done, 'contact.enabled of the compensator')
        (result,) = answer.result().results
        if not result.successful:
            raise ManipulatorError(f'contact.enabled rejected: {result.reason}')

    def move(self, goal: Pose, is_pressing: bool) -> None:
        """Move the head to a goal; after a fault, send the goal again."""
        while True:
            try:
                self.press(is_pressing)  # also after a restart of the compensator
                return self.manipulator.go_to(goal, timeout=GOAL_TIMEOUT)
            except GoalNotReachedError as error:
                print(f'{error}; {1e3 * error.progress.distance:.0f} mm are left')
            except ManipulatorError as error:  # rejected, or the drives have stopped
                print(error)
            self.make_ready()
            self.ask('The head moves to its goal again: clear the machine')

    def run(self, strokes: int, is_pressing: bool) -> None:
        """Make the strokes, move the head in, and leave the drives without power."""
        self.make_ready()
        for number in range(strokes):
            self.move(STROKES[number % 2], is_pressing)
            print(f'stroke {number + 1} of {strokes}', flush=True)
        self.move(PARKED, is_pressing=False)

    def end(self) -> None:
        """Leave the drives without power and the bus closed, and leave the ROS graph."""
        with self.manipulator:
            if self.manipulator.driver_state() == 'active':
                self.manipulator.deactivate()
            if self.manipulator.driver_state() == 'inactive':
                self.manipulator.cleanup()


def main() -> None:
    """Run the supervisor; Ctrl-C deactivates the drives."""
    parser = ArgumentParser()
    parser.add_argument('--namespace', default='')
    parser.add_argument('--strokes', type=int, default=10)
    parser.add_argument('--pressing', action='store_true')
    options = parser.parse_args()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    supervisor = Supervisor(options.namespace)
    try:
        supervisor.run(options.strokes, options.pressing)
    except KeyboardInterrupt:
        print('interrupted')
    finally:
        supervisor.end()
        rclpy.shutdown()


if __name__ == '__main__':
    main()
