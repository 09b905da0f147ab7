"""The simulated world as a node, which follows the carriages and publishes sensor readings."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
import os
import threading
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PointStamped, PoseStamped, PoseWithCovarianceStamped, WrenchStamped
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState, Range

from facade_manipulator import topics
from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Carriages, Geometry, Mechanism, Pose, Wrench
from facade_manipulator.kinematics.planar import compose, relative
from facade_manipulator.nodes import conversions, messages
from facade_manipulator.nodes.conversions import ros_time, steady_timer
from facade_manipulator.nodes.diagnostics import diagnostic_status, Diagnostics
from facade_manipulator.nodes.parameters import declare
from facade_manipulator.nodes.publisher_watch import PublisherWatch
from facade_manipulator.nodes.run import run
from facade_manipulator.parameters import parameter, settings
from facade_manipulator.simulation.world.scenario import load_scenario
from facade_manipulator.simulation.world.world import World

DELIVERY_PERIOD = 0.005  # s, between two deliveries of measurements
SILENCE = 0.1  # s without joint_states, after which the carriages stop
LONGEST_ADVANCE = 0.2  # s of the world in one callback: 20 ms of computing
CARRIAGE_SPEED = 1.0  # m/s, speed of the world's carriages towards the positions of the drives
VIEWER_PERIOD, VIEWER_TIMEOUT = 0.04, 2.0  # s, period of the pictures, and timeout of closing
ALWAYS = topics.HEAD_POSE, topics.RAIL_POSE, topics.WALL_ERROR, topics.UNCOMPENSATED_ERROR
RAW_SENSORS = topics.IMU, topics.RANGE_1, topics.RANGE_2, topics.FIX_X
TOUCHED = topics.CONTACT_WRENCH, topics.CARRIAGE_FORCES


@settings
class SimulatorSettings:
    """Choice of the simulated world; the file of the scenario contains all values."""

    scenario: str = parameter(
        'Name of a scenario in config/scenarios, or path of a file', default='breeze')
    viewer: bool = parameter("Show the world in MuJoCo's viewer", default=False)


class GondolaSimulatorNode(Node):
    """Simulate gondola, mechanism and wall; publish only the topics of the scenario."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('gondola_simulator', **kwargs)
        geometry, own = declare(self, Geometry, 'geometry'), declare(self, SimulatorSettings)
        scenario = load_scenario(own.scenario)
        self._mechanism, self._world = Mechanism(geometry), World(scenario, geometry, ros_time())
        self._frames = messages.Frames.of(self.get_namespace())
        self.diagnostics = Diagnostics(self, self._components)
        self._goal: Pose | None = None
        self._outputs = {topic.name: self.create_publisher(*topic) for topic in (
            *ALWAYS, *(RAW_SENSORS if scenario.raw_sensors else [topics.DISTURBANCE]),
            *(TOUCHED if scenario.wall.is_touched else []))}
        watch = PublisherWatch(self, self.diagnostics)
        watch.subscribe(topics.GOAL_POSE, self._receive_goal)
        watch.subscribe(topics.JOINT_STATES, self._receive_joint_states)
        steady_timer(self, DELIVERY_PERIOD, self._deliver)
        others = threading.enumerate()
        self._viewer = open_viewer(self._world) if own.viewer else None
        self._viewer_threads = {*threading.enumerate()}.difference(others)
        if self._viewer:
            steady_timer(self, VIEWER_PERIOD, self._viewer.sync)

    def close(self) -> None:
        """Close the viewer and wait for its thread, which must not draw while the process ends."""
        if self._viewer:
            self._viewer.close()
            for thread in self._viewer_threads:
                thread.join(VIEWER_TIMEOUT)

    def _publish(self, topic: str, time: float, message: Any, frame_id: str = '') -> None:
        message.header.frame_id, message.header.stamp = frame_id, conversions.stamp(time)
        self._outputs[topic].publish(message)

    def _deliver(self) -> None:
        now = ros_time()
        if now - self._world.time > SILENCE:
            self._advance(now - SILENCE, self._world.carriages)
        for name, stamp, values in self._world.raw_sensors.receive(now):
            self._publish(name, stamp, raw_message(name, values))
        for estimate in self._world.estimator.receive(now):
            message = PoseWithCovarianceStamped()
            conversions.fill_pose(message.pose.pose, estimate.pose)
            message.pose.covariance[[*messages.VARIANCES]] = estimate.variances
            self._publish(topics.DISTURBANCE.name, estimate.stamp, message, self._frames.facade)

    def _receive_goal(self, message: PoseStamped) -> None:
        goal = messages.pose_in_frame(message, self._frames.facade, 'goal_pose')
        self._mechanism.certify(goal)
        self._goal = goal

    def _receive_joint_states(self, joints: JointState) -> None:
        world = self._world
        carriages = Carriages(*messages.carriages_from(
            joints.name, joints.position, 'joint_states position'))
        self._mechanism.forward_kinematics(carriages)  # rejects impossible positions
        self._advance(messages.seconds(joints.header.stamp), carriages)
        errors = world.wall_errors(self._goal) if self._goal is not None else ()
        for topic, pose in zip(ALWAYS, (world.head, world.rail, *errors), strict=False):
            self._outputs[topic.name].publish(
                conversions.pose_stamped(self._frames.facade, world.time, pose))
        if world.scenario.wall.is_touched:
            message = WrenchStamped()
            force, torque = message.wrench.force, message.wrench.torque
            force.x, force.y, torque.z = world.measure_wrench()
            self._publish(
                topics.CONTACT_WRENCH.name, world.time, message, self._frames.end_effector)
            head, wrench = relative(world.rail, world.head), world.wrench
            fx, fy, _ = compose(Pose(0.0, 0.0, head.theta), Pose(wrench.fx, wrench.fy, 0.0))
            loads = self._mechanism.carriage_forces(head, Wrench(fx, fy, wrench.mz))
            self._publish(topics.CARRIAGE_FORCES.name, world.time, JointState(  # for the drives
                name=messages.CARRIAGES, effort=loads))

    def _advance(self, until: float, carriages: Carriages) -> None:
        """Advance the world towards a time [s], its carriages towards positions [m]."""
        world = self._world
        end = min(until, world.time + LONGEST_ADVANCE)
        way = max(end - world.time, 0.0) * CARRIAGE_SPEED
        world.advance(end, Carriages(*(
            min(max(there, here - way), here + way)
            for here, there in zip(world.carriages, carriages, strict=True))))

    def _components(self) -> list[DiagnosticStatus]:
        return [diagnostic_status('world', 'ok', 'simulating', {})]


def require_display() -> None:
    """Raise a ParameterError if no window can be opened."""
    if not os.environ.get('DISPLAY') and not os.environ.get('WAYLAND_DISPLAY'):
        raise ParameterError(
            'viewer rejected: this computer has no display (DISPLAY and WAYLAND_DISPLAY are not '
            'set); next: run it without the viewer, or on a desktop')


def open_viewer(world: World) -> Any:
    """Return MuJoCo's viewer of a world, which draws in its thread."""
    require_display()
    from mujoco import viewer

    return viewer.launch_passive(
        world.model, world.data, show_left_ui=False, show_right_ui=False)


def raw_message(name: str, values: Sequence[float]) -> Imu | PointStamped | Range:
    """Return the message of a raw sensor: inertial sensor, camera or distance sensor."""
    if name == topics.FIX_X.name:
        place = PointStamped()
        place.point.x, = values
        return place
    if name != topics.IMU.name:
        return Range(
            range=values[0], min_range=0.05, max_range=4.0, radiation_type=Range.INFRARED)
    message = Imu()
    message.orientation_covariance[0] = -1.0  # the message has no orientation
    rates, accelerations = message.angular_velocity, message.linear_acceleration
    rates.x, rates.y, rates.z, accelerations.x, accelerations.y, accelerations.z = values
    return message


main = partial(run, lambda: [GondolaSimulatorNode()])

if __name__ == '__main__':
    raise SystemExit(main())
