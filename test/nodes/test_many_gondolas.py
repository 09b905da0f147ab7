"""Two manipulators in two namespaces as separate processes: start, motion, stop and end."""

import os
from pathlib import Path
import signal

import pytest
import rclpy
from std_msgs.msg import Bool
from support import children, DEADLINE, wait_until

from facade_manipulator import config_path, topics
from facade_manipulator.client import ManipulatorClient, RequestRejectedError
from facade_manipulator.kinematics import Pose
from facade_manipulator.nodes.planar_messages import planar_pose

FILES = []
for file_name in ('manipulator.yaml', 'simulation.yaml'):
    FILES += ['--params-file', str(config_path(file_name))]
GOAL = Pose(0.05, 0.25, 0.0)


class Gondola(ManipulatorClient):
    """Driver and manipulator of a gondola, and their client, which spins the test's nodes."""

    def __init__(self, ros, start_process, namespace):
        arguments = ['--ros-args', '-r', f'__ns:=/{namespace}', *FILES]
        self.driver = start_process('facade_manipulator.nodes.driver', *arguments)
        manipulator = start_process('facade_manipulator.nodes.manipulator', *arguments)
        for process in (self.driver, manipulator):
            wait_until(
                lambda one=process: 'ready' in one.log.read_text(),
                'the start',
                3 * DEADLINE,
            )
        super().__init__(namespace, check=lambda: ros.executor.spin_once(0.0))
        self.heads = ros.collect(
            ros.node(namespace=namespace), *topics.END_EFFECTOR_POSE
        )
        self.configure()


def test_two_gondolas_move_stop_and_end_independently(ros, ros_domain, start_process):
    first, second = (
        Gondola(ros, start_process, namespace)
        for namespace in ('gondola_1', 'gondola_2')
    )
    with first, second:
        stop = second.node.create_publisher(*topics.SOFTWARE_STOP)
        second.wait_until(stop.get_subscription_count, 'the driver of gondola_2')
        stop.publish(Bool(data=True))
        with pytest.raises(RequestRejectedError, match='software_stop was set'):
            second.home()
        first.home()
        first.activate()
        # Fast DDS stops the interpreter of a node while a participant joins
        for _ in range(4):
            context = rclpy.Context()
            context.init(domain_id=ros_domain)
            rclpy.create_node('visitor', context=context).destroy_node()
            context.try_shutdown()
        first.go_to(GOAL, timeout=20.0)
        head = planar_pose(first.heads[-1].pose, 'head')
        assert head == pytest.approx(GOAL, abs=5e-3)
        own = ('/gondola_1/', '/gondola_2/')
        known = {name for name, _ in first.node.get_topic_names_and_types()}
        assert {f'{name}joint_setpoints' for name in own} <= known
        assert {name for name in known if not name.startswith(own)} <= {
            '/diagnostics',
            '/parameter_events',
            '/rosout',
        }
    (loop,) = children(first.driver.pid)
    # systemd sends the signal to the loop and to the node
    os.kill(loop, signal.SIGTERM)
    first.driver.terminate()
    wait_until(lambda: first.driver.poll() is not None, 'the end of the node')
    assert first.driver.returncode == 0
    entry = Path(f'/proc/{loop}')

    def has_ended():
        return not entry.exists() or (entry / 'stat').read_text().split()[2] == 'Z'

    wait_until(has_ended, 'the end of the loop')
    log = first.driver.log.read_text()
    assert 'The drives have confirmed that their power is off; the bus is closed' in log
    assert 'Traceback' not in log
