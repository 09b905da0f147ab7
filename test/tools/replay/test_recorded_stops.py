"""A real stop, from the drives through the black box to its replay."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
import csv
import time

import pytest
from qualities import LATEST
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from support import patiently

from facade_manipulator.nodes.driver import DriverNode
from facade_manipulator.nodes.recorder import RecorderNode
from facade_manipulator.ros.conversions import stamp
from facade_manipulator.tools.replay.__main__ import main

HOME = (-0.1, 0.1, 0.0)
CAUSES = {
    'an error of a drive': (
        lambda bench: bench.driver._loop.disturb(1, 'inject_fault', 0x8611), 'following error',
        [], 'The same cause.'),
    'software_stop': (
        lambda bench: bench.stop.publish(Bool(data=True)), 'software_stop was set',
        ['--set', 'limits.acceleration=2'],
        'With limits.acceleration=2 it would have stopped, for the same cause.'),
}


def read_csv(path):
    with path.open(encoding='utf-8') as file:
        return list(csv.DictReader(file))


class Bench:
    """A driver with simulated drives, a recorder, and setpoints that move the carriages."""

    def __init__(self, ros, folder):
        self.ros, self.folder = ros, folder
        self.driver = ros.add(DriverNode(parameter_overrides=[
            Parameter('simulate_drives', value=True),
            Parameter('controller.heartbeat_timeout', value=1.0),
            Parameter('controller.max_missed_cycles', value=10)]))
        recorder = ros.add(RecorderNode(parameter_overrides=[
            Parameter('folder', value=str(folder)), Parameter('aftermath', value=2.0)]))
        self.operator = ros.node('operator')
        self.setpoints = self.operator.create_publisher(JointState, 'joint_setpoints', LATEST)
        self.stop = self.operator.create_publisher(Bool, 'software_stop', LATEST)
        ros.until(lambda: recorder._readers['driver'].values and min(
            publisher.get_subscription_count() for publisher in (self.setpoints, self.stop)) == 2,
            'the subscriptions')
        for request in ('configure', 'home', 'activate'):
            job = self.driver._loop.request(request)
            ros.until(job.done, request)
            job.result()

    def stream(self, until, what):
        """Let the carriages move along the rail together until something is true."""
        begin = self.operator.get_clock().now().nanoseconds * 1e-9

        def step():
            now = self.operator.get_clock().now().nanoseconds * 1e-9
            shift = 0.02 * min(now - begin, 3.0)
            message = JointState(
                name=['q1', 'q2', 'q3'], position=[q + shift for q in HOME],
                velocity=[0.02 * (now - begin < 3.0)] * 3)
            message.header.stamp = stamp(now + 0.06)
            self.setpoints.publish(message)
            end = time.monotonic() + 0.01
            while time.monotonic() < end:
                self.ros.executor.spin_once(0.002)
            return until()

        self.ros.until(step, what)


@pytest.mark.parametrize('name', CAUSES)
def test_a_stop_is_recorded_and_its_replay_has_the_same_cause(ros, tmp_path, capsys, name):
    inject, cause, changes, verdict = CAUSES[name]
    bench = Bench(ros, tmp_path / 'records')
    bench.stream(lambda: bench.driver._loop.snapshot().axes[2].position > 0.01, 'motion')
    inject(bench)
    bench.stream(lambda: any(bench.folder.glob('*.mcap')), 'the file')
    (path,) = bench.folder.glob('*.mcap')

    def replayed() -> str:
        with ThreadPoolExecutor(1) as pool:  # it takes as long as it took: the drives want care
            job = pool.submit(
                main, [str(path), '--output', str(tmp_path), '--seconds', '5', *changes])
            ros.until(job.done, 'the replay', 60.0)
        printed = capsys.readouterr().out
        assert job.result() == 0
        assert printed.count(cause) >= 3  # why it was written, recorded, replayed
        assert verdict in printed
        return printed

    printed = patiently(replayed)  # in real time: a busy machine stops the drives for its own sake
    assert 'driver: operation: error: stopped' in printed
    assert 'the parameters of compensator are not in the recording' in printed
    cycles = read_csv(tmp_path / 'last_cycles.csv')
    assert len(cycles) > 100 and 'active' in {one['state'] for one in cycles}
    assert cycles[-1]['state'] == 'stopped' and float(cycles[-1]['q2.position']) != 0.0
    if name == 'an error of a drive':
        assert 'q2 after the stop: 1001h 21h, 603Fh 8611h, 1003h:01 00008611h' in printed
