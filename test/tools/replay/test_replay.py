"""A recording once more: what was computed then comes out again, and stops have their cause."""

from __future__ import annotations

from collections import defaultdict
import math
import re
from types import SimpleNamespace as Message

from can.io import CanutilsLogReader
import numpy as np
import pytest
from recorded_messages import estimate, header, pose_message

from facade_manipulator import config_path
from facade_manipulator.blackbox import Kept, read_recording, Received, RecordedRun, write_mcap
from facade_manipulator.blackbox.can_frames import CAN_TOPIC, frame_bytes
from facade_manipulator.compensation import Compensator
from facade_manipulator.drives.canopen import ERROR_FRAME
from facade_manipulator.errors import ManipulatorError, ParameterError, RecordError
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.messages import HOLD
from facade_manipulator.motion import GoalSettings, SetpointStream
from facade_manipulator.prediction import EstimateGate, EstimateSettings
from facade_manipulator.tools.calibration import read_table
from facade_manipulator.tools.replay import replay_poses, replay_setpoints, stop, StopReplay
from facade_manipulator.tools.replay.__main__ import main
from facade_manipulator.tools.replay.parameters import changed
from facade_manipulator.tools.replay.poses import INPUTS
from facade_manipulator.tools.replay.report import page
from facade_manipulator.tools.replay.timeline import LONGEST, timeline

pytestmark = pytest.mark.long

BEGIN, PERIOD, DURATION = 1000.0, 0.01, 25.0
GOAL, FAR = Pose(0.05, 0.26, 0.02), Pose(0.35, 0.26, 0.02)
HELD_AT = 22.4  # s, on the way to `FAR`, which begins at 22.0
NODE_IDS = {f'q{n}.node_id': n for n in (1, 2, 3)}
NO_STOP = StopReplay(None, None, [], [])


def sway(time):
    return Pose(0.05 * math.sin(1.3 * time), 0.01 * math.sin(2.1 * time), 0.02 * math.sin(time))


@pytest.fixture(scope='module')
def run():
    """Return what the nodes would have said in half a minute, made by the objects they use."""
    geometry, run = Geometry(), RecordedRun(begin=BEGIN, end=BEGIN + DURATION)
    run.parameters = {node: {} for node in ('compensator', 'ik_service', 'driver')}
    run.parameters['driver'] = dict(NODE_IDS)
    compensator = Compensator(geometry)
    stream = SetpointStream(geometry, GoalSettings())

    def note(topic, time, message):
        run.topics[topic].append(Received(time, message))

    for tick in range(round(DURATION / PERIOD)):
        now = BEGIN + tick * PERIOD
        if tick == 100:
            note('goal_pose', now - 0.001, pose_message(now, GOAL))
            compensator.set_goal(GOAL)
        if tick == 2200:
            note('goal_pose', now - 0.001, pose_message(now, FAR))
            compensator.set_goal(FAR)
        if tick == round(HELD_AT / PERIOD):
            compensator.hold(now - 0.001)
            note('compensator/goal_status', now - 0.001, Message(
                values=[Message(key='reason', value=HOLD)]))
        if tick % 2:
            note('disturbance', now - 0.001, estimate(
                now - 0.03, sway(now - 0.03), [1e-6] * 36))
            compensator.add_estimate(now - 0.001, now - 0.03, sway(now - 0.03), [1e-6] * 3)
        corrected = compensator.update(now)
        if corrected is not None:
            note('corrected_pose', now, pose_message(corrected.time, corrected.pose))
            setpoint = stream.setpoint(corrected.time, corrected.pose)
            note('joint_setpoints', now, Message(
                header=header(corrected.time), name=['q3', 'q1', 'q2'],
                position=np.roll(setpoint.position, 1).tolist(),
                velocity=np.roll(setpoint.velocity, 1).tolist()))
    return run


def test_poses_and_setpoints_come_out_as_they_were(run):
    poses, setpoints = replay_poses(run), replay_setpoints(run)
    assert len(poses.errors) > 400
    assert np.abs(poses.errors).max() < 1e-6
    assert len(setpoints.errors) == len(run.topics['corrected_pose'])
    assert np.abs(setpoints.errors).max() < 1e-8  # stamps are cut to nanoseconds
    text = page(CAN_PATH, run, poses, setpoints, NO_STOP)
    assert text.count('as recorded') == 2


def test_a_short_recording_is_compared_from_its_half_on(run):
    short = RecordedRun(**{**run.__dict__, 'end': BEGIN + 6.0, 'topics': defaultdict(list, {
        topic: [one for one in items if one.time < BEGIN + 6.0]
        for topic, items in run.topics.items()})})
    poses = replay_poses(short)
    assert 250 < len(poses.errors) < 350 and np.abs(poses.errors).max() < 2e-3  # m, it learns


def test_the_page_begins_with_what_differs_and_a_timeline(run):
    other = RecordedRun(**{**run.__dict__, 'about': {'version': '0.0.7'}})
    other.parameters = {**run.parameters, 'ik_service': {'geometry.link_length': 0.353},
                        'compensator': {'estimate.retard': 0.02}}
    other.topics = defaultdict(list, {**run.topics, '/diagnostics': [
        status(BEGIN + 1.0, 'operation', state='active'),
        status(BEGIN + 2.0, 'bus', 'open', missed_cycles='3'),
        status(BEGIN + 3.0, 'bus', 'open', missed_cycles='5'),
        status(BEGIN + 4.0, 'bus', 'late by 3 ms', 1, missed_cycles='5'),
        status(BEGIN + 5.0, 'bus', 'late by 4 ms', 1, missed_cycles='5'),
        status(BEGIN + 6.0, 'operation', 'stopped: late', 2, state='stopped')]})
    text = page(CAN_PATH, other, replay_poses(run), replay_setpoints(other), NO_STOP)
    assert text.index('Recorded by version 0.0.7') < text.index('## What happened') < text.index(
        '## Corrected poses')
    assert 'compensator has no estimate.retard any more' in text
    assert 'compensator had no estimate.delay then: the default' in text
    assert 'ik_service geometry.link_length = 0.353 (default 0.352)' in text
    happened = text[text.index('## What happened'):text.index('Parameters that are not')]
    assert re.findall(r'- ([\d.]+) s: (.*)', happened) == [
        ('1.00', 'driver: operation: active'),
        ('1.06', '**replayed setpoints differ from here on**'),
        ('3.00', 'driver: bus: missed cycles 3 → 5'),
        ('4.00', 'driver: bus: warn: late by 3 ms'),
        ('6.00', 'driver: operation: error: stopped: late')]


def test_where_much_is_counted_the_timeline_keeps_the_stop():
    run = RecordedRun(begin=BEGIN)
    run.topics['/diagnostics'] = [
        status(BEGIN + 1.0, 'operation', 'stopped: late', 2, state='stopped', rejected='0'),
        *(status(BEGIN + 1.0 + k, 'operation', 'stopped: late', 2, state='stopped',
                 rejected=str(k)) for k in range(1, 101))]
    left_out, *lines = timeline(run, [])
    assert (left_out, len(lines)) == ('- 61 left out, counts first', LONGEST)
    assert lines[0] == '- 1.00 s: driver: operation: error: stopped: late'
    assert lines[-1] == '- 101.00 s: driver: operation: rejected 99 → 100'


def test_another_parameter_may_be_given_and_the_page_says_what_it_would_have_done(run):
    other = changed(run, ['limits.acceleration=2', 'geometry.link_length=0.353'])
    assert other.parameters['driver']['limits.acceleration'] == 2
    assert all(values['geometry.link_length'] == 0.353 for values in other.parameters.values())
    assert 'limits.acceleration' not in run.parameters['driver']
    with pytest.raises(ParameterError, match="did you mean 'limits.acceleration'"):
        changed(run, ['limits.aceleration=2'])
    stops = {None: 'would not have stopped',
             stop.Stop(BEGIN, 'late'): 'stopped, for the same cause',
             stop.Stop(BEGIN, 'other'): 'stopped, for another cause'}
    empty = replay_setpoints(recorded(parameters=run.parameters))
    for replayed, words in stops.items():
        assert words in page(CAN_PATH, run, empty, empty, StopReplay(
            stop.Stop(BEGIN, 'late'), replayed, [], []), ['limits.acceleration=2'])


def test_poses_of_another_parameter_make_other_setpoints(run):
    other = changed(run, ['geometry.link_length=0.353'])
    poses = replay_poses(other)
    setpoints = replay_setpoints(other, poses)
    assert len(setpoints.setpoints) == len(poses.times)
    time, setpoint = setpoints.setpoints[-1]
    assert time == pytest.approx(run.end, abs=0.02)
    assert np.abs(setpoint.position - setpoints.recorded[-1]).max() > 1e-4


def test_another_software_is_seen(run):
    other = RecordedRun(**{**run.__dict__, 'parameters': {
        **run.parameters, 'ik_service': {'geometry.link_length': 0.353}}})
    assert np.abs(replay_setpoints(other).errors).max() > 1e-4
    assert '**different**' in page(
        CAN_PATH, other, replay_poses(other), replay_setpoints(other), NO_STOP)


def test_what_is_missing_is_named(run):
    empty = RecordedRun(begin=BEGIN, end=BEGIN + 1.0)
    with pytest.raises(RecordError, match='parameters of compensator'):
        replay_poses(empty)
    empty.parameters = run.parameters
    assert 'not enough was recorded' in page(
        CAN_PATH, empty, replay_poses(empty), replay_setpoints(empty), NO_STOP)
    with pytest.raises(ManipulatorError, match='no joint_setpoints'):
        stop.replay_stop(empty, 5.0)
    unknown = RecordedRun(begin=BEGIN, end=BEGIN + 1.0, topics=run.topics)
    with pytest.raises(RecordError, match='parameters of driver'):
        stop.replay_stop(unknown, 5.0)


def test_odometry_is_an_estimate_in_the_replay_as_in_the_node():
    taken = []
    compensator = Message(
        gate=EstimateGate(EstimateSettings(mounting=(0.5, 0.2, 0.0))),
        add_estimate=lambda *arguments: taken.append(arguments))
    message = estimate(BEGIN, Pose(0.55, 0.2, 0.0), range(36))
    for child in ('rail', 'prism'):
        message.child_frame_id = child
        INPUTS['disturbance_odometry'](compensator, BEGIN + 0.03, message)
    of_rail, of_prism = taken
    assert of_rail == (BEGIN + 0.03, BEGIN, Pose(0.55, 0.2, 0.0), (0.0, 7.0, 35.0), 0.0)
    assert of_prism[2] == pytest.approx((0.05, 0.0, 0.0))


def test_the_disturbance_is_written_for_a_scenario_without_what_the_nodes_reject(
        run, tmp_path, monkeypatch, capsys):
    estimates = [*run.topics['disturbance'][:3]]
    broken = estimate(BEGIN + 1e-3, Pose(math.nan, 0.0, 0.0))
    made = RecordedRun(begin=BEGIN, topics={'disturbance': [
        *estimates, Received(BEGIN, broken), estimates[0]]})
    monkeypatch.setattr('facade_manipulator.tools.replay.__main__.read_recording', lambda _: made)
    path = tmp_path / 'sway.csv'
    assert main(['a.mcap', '--disturbance', str(path)]) == 0
    assert '3 estimates over 0.0 s written' in capsys.readouterr().out
    table = read_table(path, ('time', 'x', 'y', 'theta'))
    assert table[:, 0] == pytest.approx([0.0, 0.02, 0.04])
    assert table[:, 1] == pytest.approx([sway(BEGIN - 0.02 + 0.02 * k).x for k in range(3)])


# --- stops

CAN_PATH = Message(name='blackbox.mcap')


def status(time, name, message='', level=0, **values):
    return Received(time, Message(status=[Message(
        name=f'driver: {name}', message=message, level=level,
        values=[Message(key=key.replace('_', ' '), value=value)
                for key, value in values.items()])]))


def frames(*items):
    return [Received(time, Message(
        id=cob_id & ~ERROR_FRAME, is_error=cob_id >= ERROR_FRAME, dlc=len(data),
        data=list(data.ljust(8, b'\0'))))
            for time, cob_id, data in sorted(items)]


def recorded(parameters=None, **topics):
    run = RecordedRun(begin=BEGIN, end=BEGIN + 10.0,
                      parameters=parameters or {'driver': dict(NODE_IDS)})
    run.topics.update(topics)
    return run


def told(run):
    return [(fault.time - BEGIN, fault.axis, fault.description)
            for fault in stop.drive_faults(run)]


def test_the_first_stop_after_motion_counts():
    run = recorded(**{'/diagnostics': [
        status(BEGIN - 60, 'operation', state='active', cause=''),
        status(BEGIN - 50, 'operation', state='stopped', cause='before the recording'),
        status(BEGIN + 1, 'operation', state='stopped', cause='of yesterday'),
        status(BEGIN + 2, 'operation', state='active', cause=''),
        status(BEGIN + 3, 'operation', state='stopped', cause='q2: 8611h'),
        status(BEGIN + 4, 'operation', state='stopped', cause='another')]})
    assert stop.recorded_stop(run) == stop.Stop(BEGIN + 3, 'q2: 8611h')
    assert stop.recorded_stop(recorded()) is None


def test_faults_are_read_from_the_bus_with_their_time():
    beats = [(BEGIN + 0.1 * k, cob_id, b'\5') for k in range(100) for cob_id in (0x701, 0x703)]
    run = recorded(can_frames=frames(
        *beats, (BEGIN + 2.0, 0x702, b'\5'),
        (BEGIN + 5.0, 0x081, bytes.fromhex('1186') + bytes(6)),
        (BEGIN + 7.0, ERROR_FRAME | 0x004, bytes((0, 0x20))),
        (BEGIN + 8.0, ERROR_FRAME | 0x040, b''),
        (BEGIN + 5.1, 0x083, bytes.fromhex('3081') + bytes(6)), (BEGIN + 6.0, 0x703, b'\0')))
    assert told(run) == [(2.0, 1, 'falls silent'), (5.0, 0, 'reports error 8611h'),
                         (6.0, 2, 'restarts'), (7.0, 0, 'the controller is passive'),
                         (8.0, 0, 'the controller is off')]


def test_without_frames_faults_are_read_from_diagnostics():
    run = recorded(**{'/diagnostics': [
        status(BEGIN - 1, 'q2', error_code='7305h'),
        status(BEGIN + 1, 'q1', error_code='0000h', **{'heartbeat age [s]': '0.02'}),
        status(BEGIN + 2, 'q1', error_code='8611h', **{'heartbeat age [s]': 'None'}),
        status(BEGIN + 3, 'q1', error_code='8611h'),
        status(BEGIN + 4, 'q3', error_code='-', **{'heartbeat age [s]': '0.5'})]})
    assert told(run) == [(2.0, 0, 'reports error 8611h'), (3.5, 2, 'falls silent')]


def test_causes_are_compared_without_their_numbers():
    def alike(a, b):
        return StopReplay(a and stop.Stop(0.0, a), b and stop.Stop(0.0, b), [], []).is_alike
    assert alike('late for 331.5 ms', 'late for 250 ms')
    assert not alike('late for 331 ms', 'q2: late')
    assert not alike('late', None)
    assert alike(None, None)


@pytest.mark.parametrize('known, used', [('[17, 35, 37]', 37), ('[17, 35]', 35)])
def test_the_replay_begins_at_home_by_a_method_that_the_drive_type_knows(tmp_path, known, used):
    """A profile of another computer comes from the file."""
    source = config_path('drives/simulated.yaml')
    (tmp_path / 'cia402.eds').write_bytes(source.with_name('cia402.eds').read_bytes())
    run = recorded()
    run.parameters['driver'] |= {'q1.profile': '/elsewhere/own.yaml', 'q1.homing_method': 17}
    with pytest.raises(ParameterError, match='/elsewhere/own.yaml'):
        stop.drives_at_home(run, (-0.05, 0.15, 0.05), tmp_path)
    path = tmp_path / 'own.yaml'
    path.write_text(re.sub(r'homing_methods: .*', f'homing_methods: {known}', source.read_text()))
    axis = stop.drives_at_home(run, (-0.05, 0.15, 0.05), tmp_path)[0]
    assert (axis.homing_method, axis.home_position, axis.profile) == (used, -0.05, str(path))


# --- files

def test_a_file_that_was_cut_off_is_read_as_far_as_it_goes(tmp_path):
    path = tmp_path / 'whole.mcap'
    kept = [Kept(0.001 * k, 'can_frames', frame_bytes(BEGIN, k & 0x7FF, bytes(8)))
            for k in range(60_000)]
    write_mcap(path, [CAN_TOPIC], kept, BEGIN, {
        'black box': {'reasons': 'a\nb', 'namespace': '/gondola_1', 'begin': str(BEGIN)},
        'parameters of driver': {'q1.node_id': '1'}})
    whole = read_recording(path)
    assert (whole.reasons, whole.damage, len(whole.topics['can_frames'])) == (
        ['a', 'b'], '', 60_000)
    assert whole.parameters == {'driver': {'q1.node_id': 1}}
    (tmp_path / 'half.mcap').write_bytes(path.read_bytes()[:path.stat().st_size // 2])
    half = read_recording(tmp_path / 'half.mcap')
    assert half.damage
    assert 0 < len(half.topics['can_frames']) < 60_000
    ids = [one.message.id for one in half.topics['can_frames']]
    assert ids == [k & 0x7FF for k in range(len(ids))]


def test_a_changed_bit_is_seen_wherever_it_is(tmp_path):
    path, other = tmp_path / 'whole.mcap', tmp_path / 'other.mcap'
    write_mcap(path, [CAN_TOPIC], [Kept(0.001 * k, 'can_frames', frame_bytes(
        BEGIN, k & 0x7FF, bytes(8))) for k in range(100)], BEGIN, {
        'black box': {'reasons': 'a', 'namespace': '/', 'begin': str(BEGIN), 'version': '0.0.7'},
        'parameters of driver': {'q1.node_id': '1'}})
    whole = path.read_bytes()
    assert (read_recording(path).damage, read_recording(path).about['version']) == ('', '0.0.7')
    for place in range(8, whole.index(b'\x0f\x04\0\0\0\0\0\0\0'), 7):  # to the end of the data
        other.write_bytes(whole[:place] + bytes((whole[place] ^ 4,)) + whole[place + 1:])
        try:
            assert read_recording(other).damage, place
        except RecordError:
            pass


@pytest.mark.parametrize('content', [b'', b'no mcap at all', b'\x89MCAP0\r\n'])
def test_what_is_no_file_of_the_black_box_is_a_message(tmp_path, rejected, content):
    path = tmp_path / 'a.mcap'
    path.write_bytes(content)
    assert str(path) in rejected(main, [str(path)])
    assert 'No such file' in rejected(main, [str(tmp_path / 'none.mcap')])


def test_frames_are_exported_as_a_reader_of_candump_reads_them(tmp_path):
    flags = [{}, {'is_extended': True}, {'is_rtr': True}, {'is_error': True}]
    kept = [Kept(k, 'can_frames', frame_bytes(BEGIN + k, 0x1A3, b'\1\xab', **flag))
            for k, flag in enumerate(flags)]
    write_mcap(tmp_path / 'a.mcap', [CAN_TOPIC], kept, BEGIN, {
        'black box': {'reasons': 'a test', 'namespace': '/', 'begin': str(BEGIN)}})
    assert main([str(tmp_path / 'a.mcap'), '--candump', str(tmp_path / 'a.log')]) == 0
    read = list(CanutilsLogReader(tmp_path / 'a.log'))
    assert [one.timestamp for one in read] == pytest.approx([BEGIN + k for k in range(4)])
    assert [(one.is_extended_id, one.is_remote_frame) for one in read[:3]] == [
        (False, False), (True, False), (False, True)]
    assert [one.is_error_frame for one in read] == [False, False, False, True]
    assert read[0].data == b'\1\xab'
