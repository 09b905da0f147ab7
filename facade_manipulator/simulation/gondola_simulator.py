"""Gondola_simulator node: moves a simulated world with the carriages, publishes its sensors."""

from __future__ import annotations

from functools import partial
import os
import threading
from time import monotonic
from typing import Any

from geometry_msgs.msg import Point, PoseStamped, PoseWithCovariance, Vector3
from geometry_msgs.msg import Wrench as WrenchMessage
import numpy as np
from sensor_msgs.msg import JointState, Range

from facade_manipulator import topics
from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import (
    Carriages,
    compose,
    difference,
    Mechanism,
    Pose,
)
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.nodes import conversions, planar_messages
from facade_manipulator.nodes.base_node import BaseNode
from facade_manipulator.nodes.diagnostics import diagnostic_status, Diagnostics
from facade_manipulator.nodes.node_parameters import NodeParameters
from facade_manipulator.nodes.node_settings import SimulatorSetup
from facade_manipulator.nodes.node_subscriptions import PublisherWatch
from facade_manipulator.nodes.run import run
from facade_manipulator.simulation.world.scenario import load_scenario
from facade_manipulator.simulation.world.world import World


class GondolaSimulatorNode(BaseNode):
    """Node that simulates gondola, mechanism and wall, and publishes the scenario's topics."""

    DELIVERY_PERIOD = 0.005  # s, between two deliveries of measurements
    CARRIAGE_SILENCE = 0.1  # s without joint_states, after which the carriages stop
    LONGEST_ADVANCE = 0.2  # s of the world in one callback: 20 ms of computing
    # m/s, speed of the world's carriages towards the positions of the drives
    CARRIAGE_SPEED = 1.0
    VIEWER_PERIOD = 0.04  # s, between two pictures
    VIEWER_TIMEOUT = 2.0  # s, of closing
    POSES = (
        topics.HEAD_POSE,
        topics.RAIL_POSE,
        topics.WALL_ERROR,
        topics.UNCOMPENSATED_ERROR,
    )
    RAW_SENSOR_TOPICS = topics.IMU, topics.RANGE_1, topics.RANGE_2, topics.FIX_X
    FORCES = topics.CONTACT_WRENCH, topics.CARRIAGE_FORCES

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('gondola_simulator', **kwargs)
        setup = SimulatorSetup.read(NodeParameters(self))
        scenario = load_scenario(setup.world.scenario)
        self._mechanism = Mechanism(setup.geometry)
        # on the monotonic clock, because the system clock may be set
        self._world = World(scenario, setup.geometry, monotonic())
        self._frames = planar_messages.Frames.of(self.get_namespace())
        self.diagnostics = Diagnostics(
            self, lambda: [diagnostic_status('world', 'ok', 'simulating', {})]
        )

        published = list(self.POSES)
        published += (
            self.RAW_SENSOR_TOPICS if scenario.raw_sensors else [topics.DISTURBANCE]
        )
        if scenario.wall.is_touched:
            published += self.FORCES
        self._outputs = {
            topic.name: self.create_publisher(*topic) for topic in published
        }
        #: true poses by topic; head errors are published from the first goal on
        self._poses = {
            topics.HEAD_POSE.name: lambda: self._world.head,
            topics.RAIL_POSE.name: lambda: self._world.rail,
        }

        watch = PublisherWatch(self, self.diagnostics)
        watch.subscribe(topics.GOAL_POSE, self._receive_goal)
        watch.subscribe(topics.JOINT_STATES, self._receive_joint_states)
        conversions.steady_timer(self, self.DELIVERY_PERIOD, self._deliver)

        self._viewer = open_viewer(self._world) if setup.world.viewer else None
        self.wants_priority = self._viewer is None  # drawing takes long
        if self._viewer:
            conversions.steady_timer(self, self.VIEWER_PERIOD, self._viewer.sync)

    def close(self) -> None:
        """Close the viewer and wait for its thread, which must not draw while the process ends."""
        if self._viewer:
            self._viewer.close()
            for thread in threading.enumerate():
                if thread.name.endswith('(_launch_internal)'):  # of mujoco.viewer
                    thread.join(self.VIEWER_TIMEOUT)

    def _publish(
        self, topic: str, time: float, frame_id: str = '', /, **fields: Any
    ) -> None:
        output: Any = self._outputs[topic]
        message = output.msg_type(**fields)
        message.header.frame_id = frame_id
        message.header.stamp = conversions.stamp(conversions.system_time(time))
        output.publish(message)

    def _deliver(self) -> None:
        """Publish measurements whose latency has passed; advance a world without drives."""
        now = monotonic()
        if now - self._world.time > self.CARRIAGE_SILENCE:
            self._advance(now - self.CARRIAGE_SILENCE, self._world.carriages)

        for name, stamp, values in self._world.raw_sensors.receive(now):
            frame_id = self._frames.prefix + name  # each sensor has its own frame
            self._publish(name, stamp, frame_id, **raw_fields(name, *values))
        for stamp, pose, variances, *_ in self._world.estimator.receive(now):
            estimate = PoseWithCovariance(pose=conversions.pose_message(pose))
            estimate.covariance[[*planar_messages.VARIANCES]] = variances
            self._publish(
                topics.DISTURBANCE.name, stamp, self._frames.facade, pose=estimate
            )

    def _receive_goal(self, message: PoseStamped) -> None:
        """Publish head errors from this goal on, if the goal is inside the workspace."""
        goal = planar_messages.pose_in_frame(message, self._frames.facade, 'goal_pose')
        self._mechanism.certify(goal)
        world = self._world

        def uncompensated_error() -> Pose:
            return difference(compose(world.rail, goal), goal)

        self._poses[topics.WALL_ERROR.name] = lambda: difference(world.head, goal)
        self._poses[topics.UNCOMPENSATED_ERROR.name] = uncompensated_error

    def _receive_joint_states(self, joints: JointState) -> None:
        """Advance the world to the stamp of the positions; publish errors and forces."""
        world = self._world
        positions = planar_messages.carriages_from(
            joints.name, joints.position, 'joint_states position'
        )
        carriages = Carriages(*positions)
        self._mechanism.forward_kinematics(carriages)  # rejects impossible positions
        self._advance(conversions.steady_seconds(joints.header.stamp), carriages)

        for name, pose in self._poses.items():
            if self._outputs[name].get_subscription_count():
                message = conversions.pose_message(pose())
                self._publish(name, world.time, self._frames.facade, pose=message)
        if world.scenario.wall.is_touched:
            self._publish_forces()

    def _publish_forces(self) -> None:
        """Publish the wrench on the head, and the carriage forces for the drives."""
        now = self._world.time
        fx, fy, moment = self._world.measure_wrench()
        wrench = WrenchMessage(force=Vector3(x=fx, y=fy), torque=Vector3(z=moment))
        frame_id = self._frames.end_effector
        self._publish(topics.CONTACT_WRENCH.name, now, frame_id, wrench=wrench)

        forces = -self._world.data.actuator_force
        name = topics.CARRIAGE_FORCES.name
        self._publish(name, now, name=AXIS_NAMES, effort=forces)

    def _advance(self, until: float, carriages: Carriages) -> None:
        """Advance the world towards a time [s], and its carriages towards positions [m]."""
        world = self._world
        here = np.array(world.carriages)
        end = min(until, world.time + self.LONGEST_ADVANCE)
        way = max(end - world.time, 0.0) * self.CARRIAGE_SPEED
        world.advance(end, Carriages(*np.clip(carriages, here - way, here + way)))


def open_viewer(world: World) -> Any:
    """Open MuJoCo's viewer of a world in a separate thread, and return it."""
    if not os.environ.get('DISPLAY') and not os.environ.get('WAYLAND_DISPLAY'):
        raise ParameterError(
            'viewer rejected: this computer has no display (DISPLAY and WAYLAND_DISPLAY are not '
            'set); next: run it without the viewer, or on a desktop'
        )
    from mujoco import viewer

    return viewer.launch_passive(
        world.model, world.data, show_left_ui=False, show_right_ui=False
    )


# covariance of a message without orientation
NO_ORIENTATION = np.array((-1.0, *[0.0] * 8))


def raw_fields(name: str, *values: float) -> dict[str, Any]:
    """Return the message fields of a raw sensor: inertial sensor, camera or distance sensor."""
    if name == topics.FIX_X.name:
        return {'point': Point(x=values[0])}
    if name != topics.IMU.name:
        return {
            'range': values[0],
            'min_range': 0.05,
            'max_range': 4.0,
            'radiation_type': Range.INFRARED,
        }
    wx, wy, wz, ax, ay, az = values
    return {
        'angular_velocity': Vector3(x=wx, y=wy, z=wz),
        'linear_acceleration': Vector3(x=ax, y=ay, z=az),
        'orientation_covariance': NO_ORIENTATION,
    }


main = partial(run, lambda: [GondolaSimulatorNode()])

if __name__ == '__main__':
    raise SystemExit(main())
