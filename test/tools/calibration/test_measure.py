"""`calibrate measure`, with the real nodes and simulated drives whose geometry is off."""

import csv
from dataclasses import replace
import signal
from subprocess import PIPE

from geometry_msgs.msg import PoseStamped
from made_up_machines import make_machine
import numpy as np
from own_processes import promptly
import pytest
from qualities import RELIABLE
from sensor_msgs.msg import JointState

from facade_manipulator.kinematics import Carriages, compose, Geometry, mechanism_of, Pose
from facade_manipulator.parameter_file import ALL_NODES, read_settings
from facade_manipulator.resources import config_path
from facade_manipulator.ros.client import ManipulatorClient
from facade_manipulator.ros.conversions import pose_stamped
from facade_manipulator.tools.calibration.__main__ import main
from facade_manipulator.tools.calibration.design import candidates
from facade_manipulator.tools.calibration.unknowns import heads

pytestmark = pytest.mark.long
# frame rail is where its carriages show it, as with --frame
DRAWING = Geometry()
MADE = replace(make_machine(DRAWING, np.random.default_rng(5)), rail_angle=0.0)
MADE = replace(MADE, carriage_offsets=(*MADE.carriage_offsets[:2], 0.0))
STANDS = Pose(2.0, -1.0, 2.5)  # the rail in the instrument's frame
NOISE = 5e-5, 5e-5, 2e-4  # m, m, rad
LONG = 120.0  # s


class Machine:
    """Nodes with simulated drives whose geometry is off, and an instrument that sees its head."""

    def __init__(self, ros, start_process):
        self.until, self._start = ros.until, start_process
        # a busy computer would hold the simulated drives up until they are behind their targets
        start_process('facade_manipulator.nodes.ik_service', preexec_fn=promptly(30))
        driver = start_process('facade_manipulator.nodes.driver', '--ros-args', '--params-file',
                               str(config_path('simulation.yaml')), preexec_fn=promptly(40))
        self.says(driver, 'ready; next: configure')
        node, self._random, self.seen = ros.node('instrument'), np.random.default_rng(1), None
        self._topic = node.create_publisher(PoseStamped, 'head_on_wall', RELIABLE)
        node.create_subscription(JointState, 'joint_states', self._look, 1)

    def power(self):
        with ManipulatorClient() as client:
            client.configure()
            client.home()
            client.activate()

    def _look(self, states):
        at = dict(zip(states.name, states.position, strict=True))
        head = mechanism_of(MADE).forward_kinematics(Carriages(**at))
        self.at, self.seen = at, compose(
            STANDS, Pose(*(head + NOISE * self._random.standard_normal(3))))
        self._topic.publish(pose_stamped('instrument', 1.0, self.seen))

    def measure(self, path, *options, **popen):
        return self._start('facade_manipulator.tools.calibration', 'measure', str(path), '--frame',
                           *options, **popen)

    def end_of(self, process):
        return self.until(lambda: process.poll() is not None, 'the end', LONG) and process.wait()

    def says(self, process, text):
        self.until(lambda: text in process.log.read_text(), text, LONG)


@pytest.fixture
def machine(ros, start_process):
    return Machine(ros, start_process)


@pytest.fixture
def path(tmp_path):
    made = tmp_path / 'poses.csv'
    assert main(['geometry', '--frame', '--plan', str(made)]) == 0
    return made


def measured(path):
    with path.open() as file:
        return [row for row in csv.DictReader(file) if row['x']]


def test_a_head_is_measured_until_it_is_known_and_what_was_measured_stays(
        machine, path, tmp_path):
    target, options = tmp_path / 'machine.yaml', ('--topic', '--yes', '--enough', '0.3', '0.06')
    process = machine.measure(path, *options)
    assert machine.end_of(process) == 1
    assert 'no goal is followed' in process.log.read_text() and not measured(path)
    machine.power()
    process = machine.measure(path, *options)
    machine.until(lambda: len(measured(path)) == 1, 'a row', LONG)
    before = machine.at['q3']
    machine.until(lambda: abs(machine.at['q3'] - before) > 0.02, 'a head on its way', LONG)
    process.send_signal(signal.SIGINT)
    assert machine.end_of(process) == 130
    first = measured(path)
    assert f'1 of 25 rows are measured and saved in {path}' in process.log.read_text()
    assert 'next: clear_faults' in process.log.read_text()
    with ManipulatorClient() as client:
        client.clear_faults()
    assert machine.end_of(machine.measure(path, *options)) == 0
    rows = measured(path)
    assert rows[:1] == first and 5 <= len(rows) < 12
    assert float(rows[0]['goal_x']) == float(rows[-1]['goal_x'])  # the last shows a knock
    assert main(['geometry', str(path), '--frame', '--output', str(target)]) == 0
    everywhere = candidates(DRAWING)
    after, before = ((heads(one, everywhere) - heads(MADE, everywhere)).std(axis=0) for one in (
        read_settings([target], ALL_NODES, 'geometry', Geometry), DRAWING))  # wherever rail is
    assert (after < [2e-4, 2e-4, 1e-3]).all() and (after < 0.5 * before).all()


def test_what_is_typed_wrong_is_asked_again_and_carriages_are_where_they_are(machine, path):
    machine.power()
    process = machine.measure(path, stdin=PIPE, text=True)

    def answer(text):
        process.stdin.write(text + '\n')
        process.stdin.flush()

    answer('y')
    machine.says(process, 'row 1: x [mm], y [mm], theta [deg]; Enter leaves it out:')
    answer('2000 about')
    machine.says(process, '2000 about is not x [mm], y [mm], theta [deg]. Type it again.')
    seen, at = machine.seen, machine.at
    answer(f'{1e3 * seen.x:.3f} {1e3 * seen.y:.3f} {np.rad2deg(seen.theta):.4f}'.replace('.', ','))
    machine.says(process, 'row 2: x [mm]')
    row, = measured(path)
    assert float(row['x']) == pytest.approx(seen.x, abs=2e-6)
    assert all(float(row[name]) == pytest.approx(q, abs=5e-5) for name, q in at.items())
    answer('0.3 -1000 140')
    machine.says(process, 'the bound is 50 mm from there')
    answer('')
    machine.says(process, 'row 3: x [mm]')
    process.stdin.close()
    assert machine.end_of(process) == 1
    assert 'nobody answers here' in process.log.read_text() and len(measured(path)) == 1
