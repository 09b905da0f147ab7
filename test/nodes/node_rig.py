"""Benches of nodes: a node under test, and another node that publishes and receives."""

from functools import cache, partial
import math
import socket
import subprocess
from threading import Thread

from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.parameter import Parameter
from support import DEADLINE

from facade_manipulator import topics
from facade_manipulator.control_loop.control_loop import ControlLoop
from facade_manipulator.control_loop.loop_channel import Channel
from facade_manipulator.nodes.compensator import CompensatorNode
from facade_manipulator.nodes.conversions import ros_time
from facade_manipulator.nodes.diagnostics import diagnostic_status, Diagnostics
from facade_manipulator.nodes.disturbance_estimator import DisturbanceEstimatorNode
from facade_manipulator.nodes.driver import DriverNode
from facade_manipulator.nodes.driver_status import DriverStatus
from facade_manipulator.nodes.ik_service import IkServiceNode
from facade_manipulator.nodes.planar_messages import status_level, status_values
from facade_manipulator.simulation.gondola_simulator import GondolaSimulatorNode


class LoopThread:
    """Control loop in a thread of this process, which replaces `start_process`."""

    def __init__(self, *ends: socket.socket) -> None:
        self._channel = Channel(*(end.dup() for end in ends))
        self.loop: ControlLoop | None = None
        self._thread = Thread(target=self.run, daemon=True)
        self._thread.start()

    def run(self) -> None:
        """Run the loop until its end."""
        self.loop = ControlLoop(*self._receive_setup(), self._channel)
        try:
            self.loop.run()
        finally:
            self.loop.close()

    def _receive_setup(self):
        self._channel.wait(DEADLINE)
        return next(self._channel.commands())[1]

    def wait(self, timeout: float) -> int:
        """Wait for the end; see `subprocess.Popen`."""
        self._thread.join(timeout)
        if self._thread.is_alive():
            raise subprocess.TimeoutExpired('control loop', timeout)
        return 0

    def kill(self) -> None:
        """End the loop in order, because a thread cannot be killed."""
        self.loop.end()


#: all nodes of the machine and its simulator: what makes each, by its name
NODES = {
    'driver': partial(DriverNode, LoopThread),
    'ik_service': IkServiceNode,
    'compensator': CompensatorNode,
    'disturbance_estimator': DisturbanceEstimatorNode,
    'gondola_simulator': GondolaSimulatorNode,
}


def parameters_of(values):
    """Return values by name as ROS parameters."""
    return [Parameter(name, value=value) for name, value in values.items()]


class NodeBench:
    """Node under test with parameters, and its neighbours in the graph."""

    def __init__(self, ros, make, parameters=None, **options):
        self.ros = ros
        overrides = parameters_of(parameters or {})
        self.tested = ros.add(make(parameter_overrides=overrides, **options))
        self.node = ros.node(namespace=self.tested.get_namespace())
        self.components: dict[str, DiagnosticStatus] = {}
        self.node.create_subscription(*topics.DIAGNOSTICS[:2], self._receive, 100)
        self._publisher = cache(self._make_publisher)

    def _receive(self, message):
        self.components |= {
            status.name.partition(': ')[2]: status for status in message.status
        }

    @property
    def gate(self):
        """Return the gate of commands of the node under test."""
        return self.tested._gate

    def now(self):
        return ros_time()

    def _make_publisher(self, topic):
        publisher = self.node.create_publisher(*topic)
        self.ros.until(
            publisher.get_subscription_count, f'the subscription of {topic.name}'
        )
        return publisher

    def publish(self, topic, message):
        """Publish a message, after the node has subscribed to its topic."""
        self._publisher(topic).publish(message)

    def collect(self, topic, depth=100):
        """Return a list that collects the messages on a topic."""
        qos = topics.QoSProfile(
            depth=depth,
            durability=topic.subscription_qos.durability,
            reliability=topic.qos.reliability,
        )
        return self.ros.collect(self.node, *topic[:2], qos)

    def call(self, service, request=None):
        return self.ros.call(self.node, *service, request)

    def until_status(self, component, message, level=None):
        """Wait for a level and a part of the message of a component on /diagnostics."""

        def is_there():
            status = self.components.get(component)
            return (
                status
                and message in status.message
                and (level in (None, status_level(status)))
                and status
            )

        return self.ros.until(is_there, f'{component}: {message}')

    def value(self, component, key):
        status = self.components.get(component)
        return status and status_values(status).get(key)

    def until_rejected(self, reason, count=1):
        """Wait for a number of rejections with a reason; return the last message."""
        diagnostics = self.tested.diagnostics
        self.ros.until(
            lambda: diagnostics.rejections().get(f'rejected: {reason}') == count, reason
        )
        return diagnostics.last_rejection

    def rejection_count(self):
        return self.tested.diagnostics.rejections()['rejected']

    def publish_driver(self, state, activity='holding', next_step='', since=math.inf):
        """Publish a driver/status and wait until the node has received it."""
        status = DriverStatus(state, activity, next_step, since)
        self.publish(topics.DRIVER_STATUS, driver_message(status))
        self.ros.until(lambda: self.gate.status == status, state)


def diagnostics_of(node):
    """Return the diagnostics of a node with one component."""
    return Diagnostics(node, lambda: [diagnostic_status('operation', 'ok', '', {})])


def driver_message(status):
    """Return a status of the driver as a message."""
    values = {
        name.replace('_', ' '): str(value) for name, value in status._asdict().items()
    }
    return diagnostic_status('operation', 'ok', status.state, values)


# the machine of the tests may be busy; that such time-outs act is the controller's tests'
SIMULATED = {
    'simulate_drives': True,
    'controller.heartbeat_timeout': 1.0,
    'controller.max_missed_cycles': 10,
}


class DriverBench(NodeBench):
    """Driver with simulated drives, whose control loop is a thread of the test."""

    def __init__(self, ros, parameters=None, **options):
        self.make_thread = LoopThread
        make = partial(DriverNode, self._launch)
        super().__init__(ros, make, SIMULATED | (parameters or {}), **options)

    def _launch(self, *ends):
        self.thread = self.make_thread(*ends)
        return self.thread

    def change(self, label='', number=0):
        """Request a transition by its label or its id; return whether the transition succeeds."""
        transition = Transition(label=label, id=number)
        request = ChangeState.Request(transition=transition)
        return self.call(topics.CHANGE_STATE, request).success

    def ask(self, name):
        """Return whether a request succeeds, and the driver's message."""
        if name in ('configure', 'activate'):
            return self.change(name), self.tested.last_failure
        reply = self.call(topics.HOME._replace(name=f'driver/{name}'))
        return reply.success, reply.message

    def require(self, *names):
        for name in names:
            succeeded, message = self.ask(name)
            assert succeeded, message

    def bring_up(self):
        self.require('configure', 'home', 'activate')

    @property
    def loop(self):
        """Return the node's side of the control loop."""
        return self.tested._loop

    def disturb(self, number, fault):
        """Apply a fault, a function, to a simulated drive."""
        with self.thread.loop.simulator.access() as drives:
            fault(drives[number])

    def operation(self):
        """Return the present component operation."""
        return self.tested._components()[0]

    def message(self):
        """Return the present message of the component operation."""
        return self.operation().message

    def until_state(self, label):
        self.ros.until(lambda: self.tested.state_label == label, label)
