"""The gondola simulator: it sways, estimates how, and measures the head on the wall."""

from __future__ import annotations

from dataclasses import asdict
import json

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import (
    Point,
    PointStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    WrenchStamped,
)
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import (
    Carriages,
    certify,
    forward_kinematics,
    Geometry,
    Pose,
    Wrench,
)
from facade_manipulator.parameters import parameter, settings
from facade_manipulator.ros import (
    carriages_from,
    declare,
    diagnostic_status,
    DiagnosticsPublisher,
    END_EFFECTOR,
    FACADE,
    LATEST,
    node_time,
    planar_pose,
    pose_message,
    pose_stamped,
    Rejections,
    RELIABLE,
    require_frame,
    run,
    seconds,
    stamp,
    VARIANCES,
    wrench_stamped,
)
from facade_manipulator.simulation import (
    Delivery,
    Facade,
    ForceSensor,
    load_scenario,
    PressedGondola,
    require_reaction,
    Scenario,
    SimulatedEstimator,
    WallMeasurement,
    WallSample,
)

DELIVERY_PERIOD = 0.005


@settings
class ScenarioSettings:
    """Which scenario gives the defaults of all other parameters."""

    scenario: str = parameter('', 'A name in config/scenarios or a file; empty for a breeze')


class GondolaSimulatorNode(Node):
    """Simulate what moves the rail, and judge what the manipulator makes of it."""

    def __init__(self, **kwargs) -> None:
        super().__init__('gondola_simulator', **kwargs)
        self._geometry = declare(self, Geometry, 'geometry')
        scenario = self._declare_scenario()
        course, start = scenario.motion(), node_time(self)

        def motion(time: float) -> Pose:
            return course(time - start)

        self._gondola = PressedGondola(motion, Facade(scenario.facade), scenario.gondola)
        self._estimator = SimulatedEstimator(scenario.estimator, self._gondola.at, start)
        self._wall = WallMeasurement(self._geometry, scenario.wall, self._gondola.at)
        self._sensor = ForceSensor(scenario.force_sensor) if scenario.facade.present else None
        self._sees_slip = scenario.wall.slip_sensor
        self._rejections = Rejections(self)
        self._connect()
        self._diagnostics = DiagnosticsPublisher(self, self._components)
        self.create_timer(DELIVERY_PERIOD, self._deliver)

    def _declare_scenario(self) -> Scenario:
        """Return the settings: the scenario's, where a parameter does not say otherwise."""
        name = declare(self, ScenarioSettings).scenario
        scenario = load_scenario(name) if name else Scenario()
        return require_reaction(name, scenario._replace(**{
            part: declare(self, type(settings), part, **asdict(settings))
            for part, settings in scenario._asdict().items() if part != 'compensator'}))

    def _connect(self) -> None:
        self._disturbance = self.create_publisher(
            PoseWithCovarianceStamped, 'disturbance', qos_profile_sensor_data)
        self._head, self._error, self._uncompensated = (
            self.create_publisher(PoseStamped, f'gondola_simulator/{name}', RELIABLE)
            for name in ('head_pose', 'wall_error', 'uncompensated_error'))
        self._wrench = self.create_publisher(
            WrenchStamped, 'contact_wrench', qos_profile_sensor_data)
        self._lateral = self.create_publisher(
            PointStamped, 'lateral_offset', qos_profile_sensor_data)
        self.create_subscription(PoseStamped, 'goal_pose', self._take_goal, LATEST)
        self.create_subscription(JointState, 'joint_states', self._take_joint_states, RELIABLE)
        self.create_service(Trigger, 'gondola_simulator/report', self._report)

    def _deliver(self) -> None:
        for delivery in self._estimator.advance(node_time(self)):
            self._disturbance.publish(_estimate_message(delivery))

    def _take_goal(self, message: PoseStamped) -> None:
        try:
            require_frame(message.header.frame_id, FACADE, 'goal_pose')
            goal = planar_pose(message.pose, 'goal_pose')
            certify(self._geometry, goal)
        except ManipulatorError as error:
            self._rejections.add(error)
            return
        self._wall.take_goal(node_time(self), goal)

    def _take_joint_states(self, message: JointState) -> None:
        time = seconds(message.header.stamp)
        try:
            carriages = Carriages(*carriages_from(
                message.name, message.position, 'joint_states position'))
            wrench = self._gondola.advance(
                time, forward_kinematics(self._geometry, carriages))
            sample = self._wall.take_carriages(time, carriages)
        except ManipulatorError as error:
            self._rejections.add(error)
            return
        self._head.publish(pose_stamped(FACADE, time, sample.head))
        if sample.error is not None:
            self._error.publish(pose_stamped(FACADE, time, sample.error))
            self._uncompensated.publish(pose_stamped(FACADE, time, sample.uncompensated))
        self._feel(sample, wrench)

    def _feel(self, sample: WallSample, wrench: Wrench) -> None:
        """Publish what sensors on the head tell of the wall."""
        felt = self._sensor and self._sensor.measure(sample.time, wrench)
        if felt is not None:
            self._wrench.publish(wrench_stamped(END_EFFECTOR, sample.time, felt))
        if self._sees_slip and sample.settled:
            message = PointStamped(point=Point(x=sample.lateral_offset))
            message.header.frame_id, message.header.stamp = END_EFFECTOR, stamp(sample.time)
            self._lateral.publish(message)

    def _report(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = True
        response.message = json.dumps(self._wall.report())
        return response

    def _components(self) -> list[DiagnosticStatus]:
        return [diagnostic_status(
            'wall', 'ok', 'measuring', {'samples': self._wall.count, **self._rejections.values()})]


def _estimate_message(delivery: Delivery) -> PoseWithCovarianceStamped:
    message = PoseWithCovarianceStamped()
    message.header.frame_id = FACADE
    message.header.stamp = stamp(delivery.stamp)
    message.pose.pose = pose_message(delivery.pose)
    covariance = [0.0] * 36
    for index, variance in zip(VARIANCES, delivery.variances, strict=True):
        covariance[index] = variance
    message.pose.covariance = covariance
    return message


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(lambda: [GondolaSimulatorNode()], args)


if __name__ == '__main__':
    raise SystemExit(main())
