"""The recorder: what stops the machine becomes a file that readers of other make can read."""

from __future__ import annotations

import json
import math
from pathlib import Path
import signal
from threading import Event
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
import pytest
from qualities import LATCHED, RELIABLE
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterEvent, ParameterValue
from rclpy.parameter import Parameter
from sensor_msgs.msg import Range
from std_srvs.srv import Trigger
import yaml

from facade_manipulator.blackbox.recording import metadata_of, read_recording, segment_messages
from facade_manipulator.interfaces import Quality
from facade_manipulator.kinematics import Pose
from facade_manipulator.maintenance import Journal
from facade_manipulator.messages import HOLD
from facade_manipulator.nodes.recorder import playback, RecorderNode
from facade_manipulator.ros.conversions import pose_stamped

GOAL = Pose(0.1, 0.26, 0.02)


class Machine:
    """A recorder, and a tester that speaks for the nodes of the machine."""

    def __init__(self, ros, folder: Path, **parameters) -> None:
        values = {'folder': str(folder), 'aftermath': 0.2, **parameters}
        self.ros = ros
        self.recorder = ros.add(RecorderNode(
            namespace='gondola_1',
            parameter_overrides=[Parameter(name, value=one) for name, one in values.items()]))
        self.node = ros.node('driver', namespace='gondola_1')
        self.node.declare_parameter('bus.interface', 'virtual')
        self.node.declare_parameter('q1.serial_number', 4711)
        self.diagnostics = self.publisher(DiagnosticArray, '/diagnostics')
        self.goals = self.publisher(PoseStamped, 'goal_pose')
        self.folder = folder

    def publisher(self, kind, topic, quality=RELIABLE):
        publisher = self.node.create_publisher(kind, topic, quality)
        self.ros.until(lambda: publisher.get_subscription_count() == 1, f'who hears {topic}')
        return publisher

    def say(self, state, level=DiagnosticStatus.OK, message='', name='gondola_1/driver'):
        self.diagnostics.publish(DiagnosticArray(status=[DiagnosticStatus(
            name=f'{name}: operation', level=level, message=message,
            values=[KeyValue(key='state', value=state)])]))

    def files(self):
        """Return those that are written: for a moment a name is taken by an empty one."""
        return [path for path in sorted(self.folder.glob('*.mcap')) if path.stat().st_size]

    def first_file(self):
        return self.ros.until(self.files, 'a file')[0]


def read(path):
    reader = make_reader(path.open('rb'), decoder_factories=[DecoderFactory()])
    metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    return metadata, [(channel.topic, message)
                      for _, channel, _, message in reader.iter_decoded_messages()]


@pytest.fixture
def machine(ros, tmp_path):
    return Machine(ros, tmp_path / 'records')


@pytest.mark.quick
@pytest.mark.parametrize(('state', 'level'), [
    ('stopped', DiagnosticStatus.ERROR), ('halted', DiagnosticStatus.WARN)])
def test_a_stop_makes_one_file_with_reason_goal_and_parameters(machine, state, level):
    machine.goals.publish(pose_stamped('facade', 14.0, GOAL))
    machine.say('active')
    values = machine.recorder._readers['driver'].values
    machine.ros.until(lambda: 'q1.serial_number' in values, 'the parameters')
    for step in ('clear_faults', 'activate', 'activate'):
        machine.say(state, level, f'q2: following error 8611h; next: {step}')
    metadata, messages = read(machine.first_file())
    assert metadata['black box']['reasons'] == 'driver: operation: q2: following error 8611h'
    assert json.loads(metadata['parameters of driver']['q1.serial_number']) == 4711
    goal = next(message for topic, message in messages if topic == '/gondola_1/goal_pose')
    assert (goal.pose.position.x, goal.pose.position.y) == GOAL[:2]
    said = [message.status[0].message for topic, message in messages if topic == '/diagnostics'
            and message.status[0].name == 'gondola_1/driver: operation']
    assert said[:2] == ['', 'q2: following error 8611h; next: clear_faults']
    machine.recorder.close()
    assert len(machine.files()) == 1


@pytest.mark.quick
def test_every_change_of_a_parameter_and_of_the_version_is_noted(machine):
    journal = Journal(machine.folder / 'changes_gondola_1.jsonl')

    def say(version):
        machine.diagnostics.publish(DiagnosticArray(status=[DiagnosticStatus(
            name='gondola_1/driver: operation', values=[
                KeyValue(key='state', value='active'), KeyValue(key='version', value=version)])]))

    machine.ros.until(lambda: journal.known('driver').get('q1.serial_number') == 4711, 'the start')
    machine.node.set_parameters([Parameter('q1.serial_number', value=4712)])
    say('1+ga')
    machine.ros.until(lambda: journal.known('software') == {'version': '1+ga'}, 'the version')
    say('1+gb')
    machine.ros.until(lambda: journal.known('software') == {'version': '1+gb'}, 'the update')
    machine.recorder.close()
    changed = [entry['changed'] for entry in journal.entries()]
    assert {'q1.serial_number': [4711, 4712]} in changed and changed[-1] == {
        'version': ['1+ga', '1+gb']}


@pytest.mark.quick
def test_sensors_that_the_user_has_named_are_recorded(machine):
    estimator = machine.ros.node('disturbance_estimator', namespace='gondola_1')
    estimator.declare_parameter('distances', ['laser', 'left/laser', ''])
    estimator.declare_parameter('fixes', ['no name!'])
    estimator.declare_parameter('poses', 3)
    for name in ('laser', 'left/laser'):
        machine.publisher(Range, name).publish(Range(range=0.45))
    machine.say('stopped', DiagnosticStatus.ERROR, 'a stop')
    _, messages = read(machine.first_file())
    assert {topic for topic, message in messages if hasattr(message, 'range')} == {
        '/gondola_1/laser', '/gondola_1/left/laser'}


@pytest.mark.quick
def test_what_cannot_be_read_is_kept_counted_and_ends_nothing(machine):
    events = machine.publisher(ParameterEvent, '/parameter_events')
    bad = ParameterMessage(name='foreign', value=ParameterValue(type=99))
    events.publish(ParameterEvent(node='/gondola_1/driver', changed_parameters=[bad]))
    machine.diagnostics.publish(b'\x00\x01\x00\x00')
    ros, rejections = machine.ros, machine.recorder._rejections
    ros.until(lambda: rejections.total == 2, 'both rejections')
    assert 'foreign' not in machine.recorder._readers['driver'].values
    machine.say('stopped', DiagnosticStatus.ERROR, 'a stop')
    kept = make_reader(machine.first_file().open('rb')).iter_messages()
    assert b'\x00\x01\x00\x00' in [message.data for _, _, message in kept]


@pytest.mark.quick
def test_another_gondolas_stop_is_not_ours(machine):
    machine.say('stopped', DiagnosticStatus.ERROR, 'theirs', name='gondola_2/driver')
    machine.say('active')
    machine.ros.until(lambda: machine.recorder._driver_state == 'active', 'the second message')
    machine.recorder.close()
    assert not machine.files()


@pytest.mark.quick
def test_a_driver_that_goes_silent_under_power_is_a_reason(machine, monkeypatch):
    monkeypatch.setattr('facade_manipulator.nodes.recorder.SILENCE', 0.2)
    machine.say('active')
    metadata, _ = read(machine.first_file())
    assert 'no diagnostics for' in metadata['black box']['reasons']
    assert metadata['black box']['reasons'].endswith('while it was active')


@pytest.mark.quick
def test_what_comes_between_two_looks_is_kept_whole(machine):
    goal_status = machine.publisher(DiagnosticStatus, 'compensator/goal_status', LATCHED)
    for number in range(5):
        goal_status.publish(DiagnosticStatus(message=str(number)))
        time.sleep(0.005)  # as they are sent, and no faster than they travel
    machine.ros.call(machine.node, Trigger, 'recorder/save')
    _, messages = read(machine.first_file())
    assert [message.message for topic, message in messages
            if topic == '/gondola_1/compensator/goal_status'] == list('01234')


@pytest.mark.quick
def test_a_hold_is_a_reason_unless_it_was_before_the_recorder(machine):
    goal_status = machine.publisher(DiagnosticStatus, 'compensator/goal_status', LATCHED)
    hold = DiagnosticStatus(values=[KeyValue(key='reason', value=HOLD)])
    goal_status.publish(hold)
    machine.ros.until(lambda: machine.recorder._knows_goal, 'the goal status')
    assert not machine.recorder._black_box._trigger.due(math.inf)
    for status in (DiagnosticStatus(), hold):
        goal_status.publish(status)
    metadata, _ = read(machine.first_file())
    assert metadata['black box']['reasons'] == f'compensator: {HOLD}'


def test_a_recorder_that_hangs_holds_no_publisher_up(ros, start_process, tmp_path):
    recorder = start_process('facade_manipulator.nodes.recorder', '--ros-args',
                             '-p', f'folder:={tmp_path}', '-p', 'aftermath:=0.0')
    node = ros.node('driver')
    diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', RELIABLE)
    goals = node.create_publisher(PoseStamped, 'goal_pose', RELIABLE)
    publishers = diagnostics, goals
    ros.until(lambda: all(one.get_subscription_count() for one in publishers), 'the recorder')
    recorder.send_signal(signal.SIGSTOP)
    begin = time.thread_time(), time.monotonic()
    for number in range(20 * RELIABLE.depth):
        goals.publish(pose_stamped('facade', float(number), GOAL))
        diagnostics.publish(DiagnosticArray())
    busy, took = time.thread_time() - begin[0], time.monotonic() - begin[1]
    recorder.send_signal(signal.SIGCONT)
    assert took < 2.0 + 10.0 * busy  # a publisher that waits for it does so for 0.1 s each time
    diagnostics.publish(DiagnosticArray(status=[DiagnosticStatus(
        name='driver: operation', level=DiagnosticStatus.ERROR, message='a fault')]))
    ros.until(lambda: list(tmp_path.glob('*.mcap')), 'the file', 20.0)


@pytest.mark.quick
def test_a_call_writes_a_file_and_says_where(machine):
    reply = machine.ros.call(machine.node, Trigger, 'recorder/save')
    assert reply.success
    assert reply.message == f'recorded in {machine.first_file()}'


@pytest.mark.quick
def test_while_a_disk_hangs_one_file_waits_and_no_more(machine, monkeypatch):
    hangs, write = Event(), machine.recorder._black_box._shelf.write
    monkeypatch.setattr('facade_manipulator.blackbox.black_box.LONGEST_WRITE', 0.0)
    monkeypatch.setattr(machine.recorder._black_box._shelf, 'write', lambda *arguments: (
        hangs.wait(20.0), write(*arguments))[1])
    first = machine.recorder._black_box.save('the first')
    reply = machine.ros.call(machine.node, Trigger, 'recorder/save')
    assert not reply.success and 'is still being written' in reply.message
    (status,) = machine.recorder._components()
    assert status.level == DiagnosticStatus.ERROR and 'does the disk hang?' in status.message
    hangs.set()
    machine.ros.until(first.done, 'its end')


def test_what_a_recorder_that_was_killed_had_is_the_file_of_the_next(
        ros, start_process, tmp_path):
    arguments = ('facade_manipulator.nodes.recorder', '--ros-args', '-p', f'folder:={tmp_path}')
    killed = start_process(*arguments)
    node = ros.node('driver')
    node.declare_parameter('q1.profile', 'epos4')
    goals = node.create_publisher(PoseStamped, 'goal_pose', RELIABLE)
    ros.until(goals.get_subscription_count, 'the recorder')
    goals.publish(pose_stamped('facade', 14.0, GOAL))
    ros.until(lambda: any(one.topic == '/goal_pose' for path in tmp_path.glob('.stream*/*.mcap')
                          for one in segment_messages(path, False)), 'a segment', 60.0)
    ros.until(lambda: any('parameters of driver' in metadata_of(path)
                          for path in tmp_path.glob('.stream*/*.mcap')), 'the parameters', 60.0)
    killed.kill()
    start_process(*arguments)
    path, = ros.until(lambda: [one for one in tmp_path.glob('*.mcap') if one.stat().st_size],
                      'the file', 60.0)
    metadata, messages = read(path)
    assert 'killed or lost power' in metadata['black box']['reasons']
    assert [message.pose.position.x for topic, message in messages
            if topic == '/goal_pose'] == [GOAL.x]
    assert 'epos4.yaml' in read_recording(path).files  # for a replay on another computer


@pytest.mark.quick
def test_a_folder_that_cannot_be_written_is_told_and_nothing_ends(ros, tmp_path):
    (tmp_path / 'file').write_text('')
    machine = Machine(ros, tmp_path / 'file' / 'records')
    reply = ros.call(machine.node, Trigger, 'recorder/save')
    assert not reply.success
    assert 'nothing was recorded' in reply.message
    (status,) = machine.recorder._components()
    assert (status.level, status.message) == (DiagnosticStatus.ERROR, reply.message)
    (tmp_path / 'file').unlink()
    assert ros.call(machine.node, Trigger, 'recorder/save').success


@pytest.mark.parametrize('reliable', [True, False])
@pytest.mark.parametrize('latched', [True, False])
def test_a_topic_is_played_back_with_the_quality_it_had(reliable, latched):
    offered, = yaml.safe_load(playback(Quality(7, reliable, latched)))
    assert (offered['depth'], offered['history']) == (7, 'keep_last')
    assert offered['reliability'] == ('reliable' if reliable else 'best_effort')
    assert offered['durability'] == ('transient_local' if latched else 'volatile')
    for bound in ('deadline', 'lifespan', 'liveliness_lease_duration'):  # RMW_DURATION_INFINITE
        assert 10 ** 9 * offered[bound]['sec'] + offered[bound]['nsec'] == 2 ** 63 - 1
    assert offered['avoid_ros_namespace_conventions'] is False
