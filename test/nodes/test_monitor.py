"""The terminal view: what a person reads of one manipulator."""

from __future__ import annotations

import math

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
import pytest
from rich.console import Console
from sensor_msgs.msg import JointState

from facade_manipulator.kinematics import Pose
from facade_manipulator.nodes.monitor import Observer, render
from facade_manipulator.ros.client import ManipulatorClient
from facade_manipulator.ros.conversions import pose_stamped, stamp
from facade_manipulator.ros.diagnostics import diagnostic_status
from facade_manipulator.ros.runtime import LATCHED, RELIABLE


class Screen:
    """An observer of gondola_1, what it shows, and somebody who publishes."""

    def __init__(self, ros):
        self.ros = ros
        self.observer = Observer(ros.add_client('gondola_1'))
        self.tester = ros.node('tester', namespace='gondola_1')
        create = self.tester.create_publisher
        self.diagnostics = create(DiagnosticArray, '/diagnostics', RELIABLE)
        self.joints = create(JointState, 'joint_states', RELIABLE)
        self.goals = create(DiagnosticStatus, 'compensator/goal_status', LATCHED)
        self.heads = create(PoseStamped, 'end_effector_pose', RELIABLE)
        for publisher in (self.diagnostics, self.joints, self.goals, self.heads):
            ros.until(lambda p=publisher: p.get_subscription_count(), 'the observer')

    def tell(self, name, level, message, values=(), ago=0.0):
        status = diagnostic_status(name, level, message, dict(values))
        message = DiagnosticArray(status=[status])
        now = self.tester.get_clock().now().nanoseconds * 1e-9
        message.header.stamp = stamp(now - ago)
        self.diagnostics.publish(message)

    def follow(self, x, y, angle):
        self.goals.publish(diagnostic_status('goal', 'ok', 'moving', {
            'goal stamp': '0.000000000', 'followed x [mm]': x, 'followed y [mm]': y,
            'followed angle [deg]': angle}))

    def lines(self, width=80):
        console = Console(width=width, force_terminal=False)
        with console.capture() as captured:
            console.print(render(self.observer, 'headline'))
        return captured.get().splitlines()

    def until_shown(self, *words):
        def shown():
            self.observer.client.spin(0.02)
            return next((line for line in self.lines(120) if all(w in line for w in words)), None)
        return self.ros.until(shown, f'a line with {words}')


@pytest.fixture
def screen(ros):
    clients = []

    def add_client(namespace):
        clients.append(ManipulatorClient(namespace))
        return clients[-1]

    ros.add_client = add_client
    yield Screen(ros)
    for client in clients:
        client.close()


def test_before_anything_was_heard_the_heads_stand_with_their_units(screen):
    text = '\n'.join(screen.lines())
    for head in ('x [mm]', 'y [mm]', 'position [mm]', 'speed [mm/s]', 'force [N]'):
        assert head in text
    assert text.count('no diagnostics yet') == 3


def test_poses_and_carriages_are_shown_in_millimetres_and_degrees(screen):
    screen.follow(100.0, 250.0, 2.0)
    screen.joints.publish(JointState(
        name=['q3', 'q1', 'q2'], position=[0.0, -0.1, 0.1], velocity=[0.0, 0.2, 0.0],
        effort=[0.0, 12.5, 0.0]))
    assert screen.until_shown('goal on the wall', '+100.0', '+250.0', '+2.00')
    assert screen.until_shown('q1', '-100.00', '+200.0', '+12.5')


def test_the_goal_is_shown_to_who_comes_late_until_none_is_followed(screen):
    screen.follow(100.0, 250.0, 2.0)
    late = screen.ros.add_client('gondola_1')
    screen.observer = Observer(late)
    assert screen.until_shown('goal on the wall', '+100.0', '+250.0', '+2.00')
    screen.goals.publish(diagnostic_status('goal', 'error', 'rejected', {'goal stamp': '1.0'}))
    screen.ros.until(lambda: late.spin(0.02) or 'goal on' not in '\n'.join(screen.lines()), 'none')


def test_a_component_is_shown_with_its_sentence_and_what_it_counted(screen):
    screen.tell('gondola_1/driver: bus', 'ok', 'open', {
        'cycles': 1200, 'missed cycles': 3, 'worst lateness [ms]': 1.23456})
    line = screen.until_shown('driver: bus', 'open')
    assert '1200 cycles, 3 missed, ≤ 1.23 ms late' in ' '.join(line.split())


def test_a_drive_in_fault_is_shown_beside_its_carriage(screen):
    screen.tell('gondola_1/driver: q2', 'error', 'following error (8611h)',
                {'following error [m]': 0.021})
    assert screen.until_shown('q2', '+21.00', 'following error (8611h)')


def test_a_component_that_fell_silent_no_longer_says_that_all_is_well(screen):
    screen.tell('gondola_1/driver: operation', 'ok', 'active', ago=10.0)
    line = screen.until_shown('driver: operation', 'silent for 10 s')
    assert 'active' not in line


def test_another_gondolas_components_are_not_shown(screen):
    screen.tell('gondola_2/driver: operation', 'error', 'stopped')
    screen.tell('driver: operation', 'error', 'stopped')
    screen.tell('gondola_1/driver: operation', 'ok', 'active')
    screen.until_shown('driver: operation', 'active')
    assert 'stopped' not in '\n'.join(screen.lines())


def test_a_pose_that_cannot_be_is_not_shown_and_ends_nothing(screen):
    screen.heads.publish(pose_stamped('rail', 0.0, Pose(0.1, 0.2, 0.0)))
    screen.until_shown('head, from the rail')
    screen.heads.publish(pose_stamped('rail', 0.0, Pose(math.nan, 0.2, 0.0)))
    screen.tell('gondola_1/ik_service: goal', 'error', 'x = nan')
    screen.until_shown('ik_service: goal', 'x = nan')
    assert 'head, from the rail' not in '\n'.join(screen.lines())


def test_the_whole_view_fits_a_small_terminal(screen):
    for topic in ('corrected_pose', 'gondola_simulator/uncompensated_error',
                  'gondola_simulator/wall_error'):
        screen.observer.poses[topic] = Pose(0.1, 0.2, 0.3)
        screen.observer._received_at[topic] = math.inf
    for name in ('driver: operation', 'driver: bus', 'compensator: correction',
                 'ik_service: goal', 'gondola_simulator: wall'):
        screen.tell(f'gondola_1/{name}', 'ok', 'following the goals')
        screen.until_shown(name)
    assert len(screen.lines()) <= 23 and max(map(len, screen.lines())) <= 80


def test_levels_have_a_style_each():
    from facade_manipulator.nodes.monitor import LEVEL_STYLES
    levels = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR,
              DiagnosticStatus.STALE)
    assert set(LEVEL_STYLES) == set(levels)
