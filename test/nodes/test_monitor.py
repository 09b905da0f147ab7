"""The view of the machine: what a person reads of one manipulator, or of all."""

from __future__ import annotations

import io
from itertools import pairwise
import math
from pathlib import Path
import re
import sys
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
import pytest
from qualities import LATCHED, RELIABLE
import rclpy
from rclpy.executors import ExternalShutdownException
from rich.console import Console
from sensor_msgs.msg import JointState

import facade_manipulator
from facade_manipulator.diagnostics import Report
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import CARRIAGES
from facade_manipulator.nodes.monitor import LINE_PERIOD, main, Observer, render, screen
from facade_manipulator.nodes.overview import overview, POSES, Seen
from facade_manipulator.ros.client import ManipulatorClient
from facade_manipulator.ros.conversions import pose_stamped
from facade_manipulator.ros.diagnostics import diagnostic_status

pytestmark = pytest.mark.quick

CAUSE = ('q2 (node 2): following error 8611h, the carriage is 21.3 mm behind its setpoint, bound '
         '20 mm')
NEXT = 'free the carriage, then driver/clear_faults and ros2 lifecycle set /driver activate'
STOPPED = ('driver: operation', 'error', f'stopped: {CAUSE}; next: {NEXT}',
           {'state': 'stopped', 'cause': CAUSE, 'next step': NEXT})
NOW = 1000.0


def seen(*statuses, namespace='gondola_1', at=NOW):
    """Return what is known after statuses of components, whose names may have a namespace."""
    gondolas = {}
    for name, *rest in statuses:
        space, _, component = name.rpartition('/')
        gondolas.setdefault(space or namespace, {})[component] = Report(
            at, diagnostic_status(component, *rest, *([{}] if len(rest) < 3 else [])))
    return Seen(namespace, gondolas)


def lines(known, width=80, now=NOW):
    return drawn(overview(known, now), width)


def drawn(view, width):
    console = Console(width=width, file=io.StringIO())
    console.print(render(view, 'remark', width))
    return console.file.getvalue().splitlines()


def full_machine(*more):
    known = seen(*((name, 'ok', 'following the goals', {'cycles': 1200, 'missed cycles': 3}) for (
        name) in ('driver: operation', 'driver: bus', 'compensator: correction',
                  'ik_service: goal', 'recorder: black box', *more)),
        *((f'driver: q{n}', 'ok', 'operation enabled') for n in (1, 2, 3)))
    known.poses = dict.fromkeys(POSES, (NOW, Pose(0.1, 0.25, 0.035)))
    return known


def tables(shown):
    """Return the heads of the tables in full, and the names of their rows."""
    heads = [above.split() for above, line in pairwise(shown) if line.startswith('──')]
    names = {re.split(r'\s{2,}', line)[0] for line in shown[1:] if line[:1].isalpha()}
    return heads, names


def words(text):
    return ' '.join(' '.join(text).split())


@pytest.mark.parametrize('width', [80, 60, 50])
def test_a_stop_has_its_cause_and_next_step_on_top_in_full_and_says_so_without_colours(width):
    shown = lines(seen(STOPPED, ('driver: q2', 'error', 'following error (8611h)')), width)
    assert shown[0].startswith('gondola_1: ERROR: stopped')
    top = words(shown[1:next(i for i, line in enumerate(shown) if line.startswith('pose'))])
    assert top == (f'cause: {CAUSE} next: {NEXT} '
                   'driver: q2: ERROR: following error (8611h) '
                   'recorder: black box: warning: no diagnostics: no stop is recorded; '
                   'next: start recorder')
    assert NEXT not in words(shown).replace(top, '')  # once
    assert max(map(len, shown)) <= width and '…' not in ''.join(shown)


def test_a_machine_in_order_has_no_troubles_and_fits_a_small_terminal():
    shown = lines(full_machine('gondola_simulator: wall'))
    assert shown[0] == 'gondola_1: following the goals   remark' and shown[1].startswith('pose')
    assert len(shown) <= 23, 'a row more, or a table too wide:\n' + '\n'.join(shown)
    assert '1200 cycles, 3 missed' in words(shown)
    assert '+100.0 +250.0 +2.01' in words(shown)


def test_the_screen_in_the_documents_has_the_tables_and_rows_that_there_are():
    page = (Path(facade_manipulator.__file__).parents[1] / 'docs/operation.md').read_text()
    sample = re.search(r'```\n(gondola_1: active .*?)```', page, re.DOTALL)[1].splitlines()
    known = full_machine()
    known.joints = NOW, JointState(
        name=CARRIAGES, position=[0.1] * 3, velocity=[0.0] * 3, effort=[1.0] * 3)
    assert tables(sample) == tables(lines(known))


@pytest.mark.parametrize('level, word', [
    ('ok', ' open'), ('warn', 'warning: open'), ('error', 'ERROR: open'),
    ('stale', 'stale: open')])
def test_each_level_has_its_word(level, word):
    assert word in words(lines(seen(('driver: bus', level, 'open'))))


def test_a_drive_that_silent_components_no_longer_vouch_for_is_no_green_one():
    known = seen(('driver: operation', 'ok', 'active'), at=NOW - 10.0)
    shown = words(lines(known))
    assert shown.count('stale: silent for 10 s; next: see its log') == 2  # title and top
    assert shown.count('stale: silent for 10 s') == 3  # and table
    assert 'active' not in shown


def test_who_is_missing_is_shown_with_what_to_do():
    shown = words(lines(Seen('gondola_1')))
    assert 'warning: no diagnostics; next: start driver' in shown
    assert 'recorder: black box: warning: no diagnostics: no stop is recorded; next:' in shown
    for head in ('x [mm]', 'position [mm]', 'speed [mm/s]', 'force [N]'):
        assert head in shown


def test_without_a_namespace_each_gondola_has_its_line():
    known = seen(('a/' + STOPPED[0], *STOPPED[1:]), ('b/driver: operation', 'ok', 'active'),
                 ('camera/lens: focus', 'error', 'dirty'), namespace='')
    shown = lines(known, 500)
    assert [line.split()[0] for line in shown[-3:-1]] == ['a', 'b']
    assert CAUSE in shown[-3] and NEXT in shown[-3] and 'active' in shown[-2]
    assert 'camera' not in words(shown)
    assert {'gondola', 'state', 'why'} <= {*words(lines(known, 60)).split()}  # narrow


@pytest.mark.parametrize('checksum', ['12e45678', '00000120', '1a2b3c4d'])
def test_version_and_checksum_are_shown_whatever_number_they_look_like(checksum):
    known = seen(('driver: operation', 'ok', 'active', {
        'version': '0.2.0+g1a2b3c4', 'parameters': checksum}))
    assert f'version 0.2.0+g1a2b3c4, parameters {checksum}' in words(lines(known, 200))


def test_another_gondolas_components_are_not_shown():
    known = seen(('gondola_2/' + STOPPED[0], *STOPPED[1:]), ('driver: operation', 'ok', 'active'))
    assert 'stopped' not in words(lines(known))


@pytest.mark.parametrize('terminal', [None, 'dumb'])
def test_where_nothing_can_be_written_again_news_and_a_line_now_and_then_are_printed(
        monkeypatch, terminal):
    now = SimpleNamespace(time=0.0)
    monkeypatch.setattr('facade_manipulator.nodes.monitor.time.monotonic', lambda: now.time)
    monkeypatch.setenv('TERM', terminal or 'xterm')
    console = Console(file=io.StringIO(), force_terminal=terminal is not None, width=80)
    late, later, stopped = (overview(seen(one), NOW) for one in (
        ('driver: operation', 'warn', 'active; late in 0.6 % of 500 cycles'),
        ('driver: operation', 'warn', 'active; late in 12 % of 500 cycles'), STOPPED))
    with screen(console) as show:
        for now.time in (0.0, 1.0, LINE_PERIOD, LINE_PERIOD + 1.0):
            show(later if now.time else late, f'at {now.time:g} s')
        show(stopped, 'then')
    text = console.file.getvalue()
    assert re.findall(r'at . s', text) == ['at 0 s', f'at {LINE_PERIOD:g} s']
    assert text.count('gondola_1: warning') == 1 and text.count('cause: q2') == 1
    assert '\x1b[' not in text or terminal == 'dumb' and '\x1b[2K' not in text


class Machine:
    """An observer of gondola_1 and somebody who publishes."""

    def __init__(self, ros, client):
        self.ros, self.observer = ros, Observer(client)
        self.client = client
        self.tester = ros.node('tester', namespace='gondola_1')
        create = self.tester.create_publisher
        self.diagnostics = create(DiagnosticArray, '/diagnostics', RELIABLE)
        self.joints = create(JointState, 'joint_states', RELIABLE)
        self.goals = create(DiagnosticStatus, 'compensator/goal_status', LATCHED)
        self.heads = create(PoseStamped, 'end_effector_pose', RELIABLE)
        for publisher in (self.diagnostics, self.joints, self.goals, self.heads):
            ros.until(lambda p=publisher: p.get_subscription_count(), 'the observer')

    def until_shown(self, text, shown=True):
        def is_shown():
            self.client.spin(0.02)
            return (text in words(drawn(self.observer.overview(), 120))) is shown
        self.ros.until(is_shown, text)


@pytest.fixture
def machine(ros):
    with ManipulatorClient('gondola_1') as client:
        yield Machine(ros, client)


def test_what_is_published_is_shown_however_wrong_the_senders_clock_is(machine):
    message = DiagnosticArray(status=[diagnostic_status(
        'gondola_1/driver: operation', 'ok', 'active', {})])
    for machine_time in (0, 2_000_000_000):
        message.header.stamp.sec = machine_time
        machine.diagnostics.publish(message)
        machine.until_shown('gondola_1: active')
    machine.joints.publish(JointState(
        name=['q3', 'q1', 'q2'], position=[0.0, -0.1, 0.1], velocity=[0.0, 0.2, 0.0],
        effort=[0.0, 12.5, 0.0]))
    machine.until_shown('-100.00 +200.0 +12.5')


def test_the_goal_is_shown_to_who_comes_late_until_none_is_followed(machine):
    machine.goals.publish(diagnostic_status('goal', 'ok', 'moving', {
        'goal stamp': '0.000000000', 'followed x [mm]': 100.0, 'followed y [mm]': 250.0,
        'followed angle [deg]': 2.0}))
    machine.until_shown('goal on the wall +100.0 +250.0 +2.00')
    machine.observer = Observer(machine.client)
    machine.until_shown('goal on the wall +100.0 +250.0 +2.00')
    machine.goals.publish(diagnostic_status('goal', 'error', 'rejected', {'goal stamp': '1.0'}))
    machine.until_shown('goal on the wall', False)


def test_a_pose_that_cannot_be_is_not_shown_and_ends_nothing(machine):
    machine.heads.publish(pose_stamped('rail', 0.0, Pose(0.1, 0.2, 0.0)))
    machine.until_shown('head, from the rail')
    machine.heads.publish(pose_stamped('rail', 0.0, Pose(math.nan, 0.2, 0.0)))
    machine.until_shown('head, from the rail', False)


@pytest.mark.parametrize('end', [KeyboardInterrupt, ExternalShutdownException, None])
def test_the_view_ends_without_a_word_however_it_is_ended(ros_domain, monkeypatch, capsys, end):
    def spin(client, duration, spin=ManipulatorClient.spin):
        spin(client, 0.0)
        seen.append(client.namespace)
        if len(seen) == 2 and end is None:
            rclpy.shutdown()
        elif len(seen) == 2:
            raise end

    seen = []
    monkeypatch.setattr(ManipulatorClient, 'spin', spin)
    monkeypatch.setattr(sys, 'argv', ['a_test'])
    assert main(['--namespace', 'gondola_1', '--ros-args', '-p', 'of:=ros']) == 0
    assert not rclpy.ok() and seen == ['gondola_1'] * 2
    assert 'gondola_1: warning: no diagnostics; next: start driver' in words(
        capsys.readouterr().out.splitlines())


@pytest.mark.parametrize('arguments, status', [(['--help'], 0), (['nonsense'], 2)])
def test_arguments_that_are_not_known_end_the_view(monkeypatch, capsys, arguments, status):
    monkeypatch.setattr(sys, 'argv', ['monitor', *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == status and 'usage: monitor' in ''.join(capsys.readouterr())
