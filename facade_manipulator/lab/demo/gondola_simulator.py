"""The gondola simulator: it sways, estimates how, and measures the head on the wall."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
import json
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, PointStamped, PoseStamped
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState, Range

from facade_manipulator import interfaces, messages
from facade_manipulator.kinematics import Carriages, Geometry, mechanism_of, Pose, relative, Wrench
from facade_manipulator.lab.gondola.reaction import carriage_loads
from facade_manipulator.lab.gondola.scenario import Scenario
from facade_manipulator.lab.gondola.wall import WallMeasurement, WallSample
from facade_manipulator.nodes.parameters import declare
from facade_manipulator.parameters import parameter, settings
from facade_manipulator.ros.clocks import steady_timer
from facade_manipulator.ros.codec import estimate_codec
from facade_manipulator.ros.conversions import frames, node_time, PoseStream, stamp, wrench_stamped
from facade_manipulator.ros.diagnostics import diagnostic_status, DiagnosticsPublisher, Rejections
from facade_manipulator.ros.interfaces import publisher, subscription
from facade_manipulator.ros.lifecycle import offer_trigger
from facade_manipulator.ros.runtime import run
from facade_manipulator.simulation.world.scenario import load_scenario
from facade_manipulator.simulation.world.world import World

DELIVERY_PERIOD = 0.005
SILENCE = 0.1  # s without joint_states, after which the carriages stand still
LONGEST_ADVANCE = 0.2  # s of the world in one callback: 20 ms of computing
CARRIAGE_SPEED = 1.0  # m/s, with which the world's carriages go to where those of the drives are
RAW_SENSORS = interfaces.IMU, interfaces.RANGE_1, interfaces.RANGE_2, interfaces.FIX_X


@settings
class ScenarioSettings:
    """Which scenario is simulated; its file has all the numbers."""

    scenario: str = parameter(
        'A name in config/world/scenarios, or a file', default='breeze')


class GondolaSimulatorNode(Node):
    """Simulate what moves the rail, and measure what the manipulator makes of it."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('gondola_simulator', **kwargs)
        geometry = declare(self, Geometry, 'geometry')
        self._mechanism = mechanism_of(geometry)
        self._scenario = load_scenario(declare(self, ScenarioSettings).scenario)
        self._world = World(self._scenario, geometry, node_time(self))
        self._wall = WallMeasurement(
            Scenario().wall, lambda _: self._world.rail)
        self._rejections = Rejections(self)
        self._connect()
        self._diagnostics = DiagnosticsPublisher(self, self._components)
        steady_timer(self, DELIVERY_PERIOD, self._deliver)

    def _connect(self) -> None:
        self._frames = frames(self)
        self._estimate_codec = estimate_codec('disturbance', self._frames.facade)
        # only what the scenario has: another publisher of the topic would be rejected
        if self._scenario.raw_sensors:
            self._raw = {one.name: publisher(self, one) for one in RAW_SENSORS}
        else:
            self._disturbance = publisher(self, interfaces.DISTURBANCE)
        self._head, self._error, self._uncompensated = (
            PoseStream(self, topic, self._frames.facade) for topic in (
                interfaces.HEAD_POSE, interfaces.WALL_ERROR, interfaces.UNCOMPENSATED_ERROR))
        if self._scenario.wall.is_touched:
            self._wrench = publisher(self, interfaces.CONTACT_WRENCH)
            self._loads = publisher(self, interfaces.CARRIAGE_FORCES)
        subscription(self, interfaces.GOAL_POSE, self._receive_goal)
        subscription(self, interfaces.JOINT_STATES, self._receive_joint_states)
        offer_trigger(self, interfaces.REPORT, lambda: json.dumps(self._wall.report()))

    def _deliver(self) -> None:
        now = node_time(self)
        if now - self._world.time > SILENCE:
            self._advance(now - SILENCE, self._world.carriages)
        for name, time, values in self._world.raw_sensors.receive(now):
            self._raw[name].publish(raw_message(name, time, values))
        for estimate in self._world.estimator.receive(now):
            self._disturbance.publish(self._estimate_codec.write(
                estimate.stamp, (*messages.planar_numbers(estimate.pose), *estimate.variances)))

    def _advance(self, time: float, carriages: Carriages) -> None:
        """Advance the world towards a time [s], its carriages towards positions [m]."""
        end = min(time, self._world.time + LONGEST_ADVANCE)
        way = max(end - self._world.time, 0.0) * CARRIAGE_SPEED
        self._world.advance(end, Carriages(*(
            min(max(there, here - way), here + way)
            for here, there in zip(self._world.carriages, carriages, strict=True))))

    def _receive_goal(self, message: PoseStamped) -> None:
        with self._rejections:
            goal = messages.pose_in_frame(message, self._frames.facade, 'goal_pose')
            self._mechanism.certify(goal)
            self._wall.set_goal(node_time(self), goal)

    def _receive_joint_states(self, message: JointState) -> None:
        time = messages.seconds(message.header.stamp)
        with self._rejections:
            carriages = Carriages(*messages.carriages_from(
                message.name, message.position, 'joint_states position'))
            self._mechanism.forward_kinematics(carriages)  # rejects what no mechanism can be
            self._advance(time, carriages)
            self._publish_world()

    def _publish_world(self) -> None:
        time, head = self._world.time, relative(self._world.rail, self._world.head)
        self._publish_sample(self._wall.measure(time, head))
        if self._scenario.wall.is_touched:
            self._wrench.publish(wrench_stamped(
                self._frames.end_effector, time, self._world.measure_wrench()))
            self._publish_loads(time, head, self._world.wrench)

    def _publish_sample(self, sample: WallSample) -> None:
        self._head.publish(sample.time, sample.head)
        if sample.error is not None and sample.uncompensated is not None:
            self._error.publish(sample.time, sample.error)
            self._uncompensated.publish(sample.time, sample.uncompensated)

    def _publish_loads(self, time: float, head: Pose, wrench: Wrench) -> None:
        """Publish what the wall does to the carriages, for simulated drives to feel."""
        loads = carriage_loads(self._mechanism, head, wrench)
        message = JointState(name=list(messages.CARRIAGES), effort=list(loads))
        message.header.stamp = stamp(time)
        self._loads.publish(message)

    def _components(self) -> list[DiagnosticStatus]:
        return [diagnostic_status(
            'wall', 'ok', 'measuring', {'samples': self._wall.count, **self._rejections.values()})]


def raw_message(name: str, time: float, values: Sequence[float]) -> Imu | PointStamped | Range:
    """Return what a raw sensor publishes: the inertial one, the camera or one of a distance."""
    if name == interfaces.IMU.name:
        message = Imu()
        message.orientation_covariance[0] = -1.0  # it has none
        for vector, numbers in ((message.angular_velocity, values[:3]),
                                (message.linear_acceleration, values[3:])):
            vector.x, vector.y, vector.z = numbers
    elif name == interfaces.FIX_X.name:
        message = PointStamped(point=Point(x=values[0]))
    else:
        message = Range(
            range=values[0], min_range=0.05, max_range=4.0, radiation_type=Range.INFRARED)
    message.header.stamp = stamp(time)
    return message


main = partial(run, lambda: [GondolaSimulatorNode()])

if __name__ == '__main__':
    raise SystemExit(main())
