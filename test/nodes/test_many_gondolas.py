"""Two manipulators in two namespaces, each on its own bus, as separate processes."""

from __future__ import annotations

import os
import signal

import pytest
from std_msgs.msg import Bool
from support import wait_until

from facade_manipulator import config_path, topics
from facade_manipulator.client import ManipulatorClient, RequestRejectedError
from facade_manipulator.kinematics import Pose
from facade_manipulator.nodes.messages import planar_pose

GONDOLAS = ('gondola_1', 'gondola_2')
FILES = [word for name in ('manipulator', 'simulation')
         for word in ('--params-file', str(config_path(f'{name}.yaml')))]
NEAR, FAR, OUTSIDE = Pose(0.05, 0.25, 0.0), Pose(-0.2, 0.25, 0.0), Pose(0.0, 0.6, 0.0)


class Gondola(ManipulatorClient):
    """Driver and manipulator of a gondola, and their client, which spins the test's nodes."""

    def __init__(self, ros, start_process, namespace):
        arguments = ('--ros-args', '-r', f'__ns:=/{namespace}', *FILES)
        self.driver, manipulator = (
            start_process(f'facade_manipulator.nodes.{module}', *arguments)
            for module in ('driver', 'manipulator'))
        for process in (self.driver, manipulator):
            wait_until(lambda one=process: 'ready' in one.log.read_text(), 'the start')
        super().__init__(namespace, check=lambda: ros.executor.spin_once(0.0))
        self.heads, self.statuses = (
            ros.collect(ros.node(namespace=namespace), *topic)
            for topic in (topics.END_EFFECTOR_POSE, topics.GOAL_STATUS))

    def bring_up(self):
        self.configure()
        self.home()
        self.activate()
        self.wait_until(lambda: self.heads, 'the pose of the head')

    def head(self):
        return planar_pose(self.heads[-1].pose, 'head')

    def until_ended(self, reason):
        self.wait_until(lambda: reason in self.statuses[-1].message, f'the end: {reason}', 20.0)


@pytest.fixture
def gondolas(start_process, ros):
    first, second = (Gondola(ros, start_process, namespace) for namespace in GONDOLAS)
    with first, second:
        yield first, second


def test_two_gondolas_move_and_stop_independently(gondolas):
    first, second = gondolas
    with pytest.raises(RequestRejectedError, match='the drives are unconfigured'):
        first.go_to(NEAR)
    first.bring_up()
    second.bring_up()
    known = {name for name, _ in first.node.get_topic_names_and_types()}
    own = tuple(f'/{name}/' for name in GONDOLAS)
    assert {f'{name}joint_setpoints' for name in own} <= known
    assert {name for name in known if not name.startswith(own)} <= {
        '/diagnostics', '/parameter_events', '/rosout'}

    at_rest = second.head()
    first.go_to(FAR, NEAR, timeout=20.0)
    assert first.head() == pytest.approx(NEAR, abs=5e-3)
    assert second.head() == pytest.approx(at_rest, abs=1e-4)

    stop = second.node.create_publisher(Bool, 'software_stop', topics.LATEST)
    second.wait_until(stop.get_subscription_count, 'the driver of gondola_2')
    stop.publish(Bool(data=True))
    second.wait_until(lambda: second.driver_state() == 'inactive', 'the stop of gondola_2')
    assert first.driver_state() == 'active'
    with pytest.raises(RequestRejectedError, match='software_stop was set'):
        second.activate()

    with pytest.raises(RequestRejectedError, match='rejected: '):
        first.go_to(OUTSIDE)
    first.send_goal(FAR)
    first.halt()
    first.until_ended('ended: the drives are halt')
    first.clear_faults()
    first.send_goal(FAR)
    os.killpg(first.driver.pid, signal.SIGKILL)
    first.driver.wait()
    first.until_ended('ended: the driver is silent')
