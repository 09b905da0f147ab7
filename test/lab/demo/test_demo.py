"""The demo as people run it: a process, its report, and what is left after Ctrl-C."""

import json
import math
import os
from pathlib import Path
import re
import signal
from threading import Event
import time
from types import SimpleNamespace

import numpy as np
import pytest
from support import children, patiently, wait_until

from facade_manipulator import config_path
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.interfaces import END_EFFECTOR_POSE, GOAL_POSE, HEAD_POSE, REFERENCE
from facade_manipulator.kinematics import add, compose, Geometry, invert, Pose
from facade_manipulator.lab.demo import demo as demo_module
from facade_manipulator.lab.demo.animation import before_and_after
from facade_manipulator.lab.demo.collector import Collector
from facade_manipulator.lab.demo.course import course_of
from facade_manipulator.lab.demo.demo import Demo
from facade_manipulator.lab.gondola import pictures
from facade_manipulator.lab.gondola.course import figures
from facade_manipulator.ros.conversions import pose_stamped
from facade_manipulator.ros.interfaces import publisher
from facade_manipulator.simulation.world.scenario import load_scenario, scenario_names, Wall

DEMO = 'facade_manipulator.lab.demo'
SETTLED = 10.0
RUN_DEADLINE = 90.0
FREEZE = 1.0  # s, far beyond what drives forgive
LARGEST_ANIMATION = 2_000_000
ANSWER = 1.0  # s
PROMPT = 3.0  # s, of which the nodes need one to end


class DeadClient:
    """A client whose driver does not answer yet."""

    def __init__(self, *_):
        self.node = None

    def driver_state(self):
        pytest.fail('the demo waits for a driver that was not activated')

    def close(self):
        self.node = None


def made_demo(monkeypatch, folder, **options):
    """Return a demo without nodes, with a folder and options."""
    monkeypatch.setattr(demo_module, 'ManipulatorClient', DeadClient)
    monkeypatch.setattr(demo_module, 'Collector', lambda node: None)
    demo = Demo(SimpleNamespace(**{
        'output': folder, 'namespace': 'demo', 'scenario': '', 'duration': None,
        'parameters': config_path('manipulator.yaml'), **options}), Event())
    demo.processes = SimpleNamespace(start=lambda *_: None, end=lambda: None)
    return demo


@pytest.mark.parametrize(('scenario', 'duration', 'used', 'missing'), [
    ('', None, 30.0, ''),
    ('gusts', None, 60.0, ''),
    ('flips', 10.0, 10.0, 'the second without estimates; next: set a duration of 25 s'),
    ('pressing', 8.0, 8.0, 'the head pressing with 30 N; next: set a duration of 20 s'),
    ('sensors', 7.0, 7.0, 'the estimator in its steady state; next: set a duration of 15 s'),
])
def test_duration_too_short_for_a_scenario_names_what_is_missing(
        monkeypatch, tmp_path, capsys, scenario, duration, used, missing):
    demo = made_demo(monkeypatch, tmp_path, scenario=scenario, duration=duration)
    demo._start_nodes()
    printed = capsys.readouterr().out
    assert demo.duration == used
    assert f'too short to show {missing}' in printed if missing else 'too short' not in printed


@pytest.mark.parametrize('name', scenario_names())
def test_default_duration_of_a_scenario_shows_its_event(name):
    mission = load_scenario(name).mission
    assert mission.duration >= mission.shown_after


def ended(process):
    return process.poll() is not None


def test_a_run_compensates_and_leaves_its_report(start_process, tmp_path):
    def run():
        process = start_process(
            DEMO, '--duration', str(SETTLED), '--output', str(tmp_path / 'report'))
        wait_until(lambda: ended(process), 'the end of the demo', RUN_DEADLINE)
        text = process.log.read_text()
        assert process.returncode == 0, text
        summary = json.loads((tmp_path / 'report' / 'summary.json').read_text())
        for axis, least in (('x', 20.0), ('y', 12.0), ('theta', 12.0)):
            assert summary['axes'][axis]['attenuation_db'] >= least, text
            assert summary['axes'][axis]['residual_rms'] < summary['axes'][axis]['disturbance_rms']
        return text, summary

    text, summary = patiently(run)  # a busy computer delays the simulated world
    assert summary['duration_s'] >= SETTLED
    assert summary['bus_cycles'] > 50 * SETTLED
    assert summary['drive_faults'] == summary['rejected_goals'] == 0
    assert 0.0 < summary['pipeline_latency_ms']['p50'] <= summary['pipeline_latency_ms']['p99']
    for name in ('time_courses.png', 'spectrum.png', 'path.png', 'before_after.png'):
        assert (tmp_path / 'report' / name).read_bytes().startswith(b'\x89PNG')
    animation = (tmp_path / 'report' / 'linkage.gif').read_bytes()
    assert animation.startswith(b'GIF89a') and animation.endswith(b';')
    assert len(animation) <= LARGEST_ANIMATION
    assert not (tmp_path / 'report' / 'force.png').exists()  # there is no wall to touch
    assert not list((tmp_path / 'report').glob('.*.part'))
    assert 'uncompensated' in text and 'Traceback' not in text


@pytest.mark.parametrize('moment', ['driver: configure', 'driver: home', ' 0.0 s '])
def test_ctrl_c_is_answered_and_leaves_nothing_running(start_process, tmp_path, moment):
    process = start_process(DEMO, '--duration', '60', '--output', str(tmp_path / 'report'))
    wait_until(lambda: moment in process.log.read_text(), f'"{moment}"', RUN_DEADLINE)
    nodes = children(process.pid)
    os.kill(process.pid, signal.SIGINT)
    wait_until(lambda: 'interrupted: stopping' in process.log.read_text(), 'the answer', ANSWER)
    wait_until(lambda: ended(process), 'the end of the demo')
    text = process.log.read_text()
    assert process.returncode == 130, text
    assert 'interrupted: drives stopped, nodes ended' in text and 'Traceback' not in text
    assert [pid for pid in nodes if Path(f'/proc/{pid}').exists()] == []


def test_ctrl_c_during_imports_is_one_line(start_process):
    process = start_process(DEMO)
    caught = f'/proc/{process.pid}/status'
    wait_until(lambda: int(re.search(r'SigCgt:\s*(\w+)', Path(caught).read_text())[1], 16)
               >> (signal.SIGTERM - 1) & 1, 'the handlers of signals')
    os.kill(process.pid, signal.SIGINT)
    wait_until(lambda: ended(process), 'the end of the demo', ANSWER)
    assert process.returncode == 130
    assert process.log.read_text() == 'demo: interrupted: nothing was started\n'


def test_ctrl_c_before_the_driver_answers_ends_promptly(start_process, tmp_path):
    process = start_process(DEMO, '--output', str(tmp_path / 'report'))
    wait_until(lambda: 'starting' in process.log.read_text(), 'the start', RUN_DEADLINE)
    os.kill(process.pid, signal.SIGINT)
    wait_until(lambda: 'interrupted: stopping' in process.log.read_text(), 'the answer', ANSWER)
    wait_until(lambda: ended(process), 'the end of the demo', PROMPT)
    assert process.returncode == 130


def test_stop_before_activation_does_not_wait_for_the_driver(monkeypatch, tmp_path):
    demo = made_demo(monkeypatch, tmp_path)
    demo._stop()
    assert demo.client.node is None


def test_start_removes_only_files_that_the_demo_writes(monkeypatch, tmp_path):
    old = ('summary.json', 'force.png', 'linkage.gif', 'driver.log', 'disturbance_estimator.log',
           'compensator.yaml')
    for name in (*old, 'notes.txt', 'other.log'):
        (tmp_path / name).write_text('earlier')
    made_demo(monkeypatch, tmp_path)._start_nodes()
    assert {'notes.txt', 'other.log'} <= {path.name for path in tmp_path.iterdir()}
    assert not any((tmp_path / name).exists() and (tmp_path / name).read_text() == 'earlier'
                   for name in old)


@pytest.mark.parametrize(('scenario', 'duration', 'used'), [
    ('', None, 30.0), ('gusts', None, 60.0), ('gusts', 10.0, 10.0)])
def test_duration_is_that_of_option_or_scenario(monkeypatch, tmp_path, scenario, duration, used):
    assert made_demo(monkeypatch, tmp_path, scenario=scenario, duration=duration).duration == used


def test_ctrl_c_while_drawing_leaves_only_complete_files(start_process, tmp_path):
    process = start_process(DEMO, '--duration', '1', '--output', str(tmp_path / 'report'))
    wait_until(
        lambda: 'drawing the pictures' in process.log.read_text(), 'the drawing', RUN_DEADLINE)
    os.kill(process.pid, signal.SIGINT)
    wait_until(lambda: ended(process), 'the end of the demo')
    text = process.log.read_text()
    assert process.returncode == 130, text
    assert 'Traceback' not in text
    assert not list((tmp_path / 'report').glob('.*.part'))
    assert not (tmp_path / 'report' / 'linkage.gif').exists()
    assert json.loads((tmp_path / 'report' / 'summary.json').read_text())


class Tables(dict):
    """What a collector has collected, by topic."""

    def table(self, topic):
        return np.array(self.get(topic, [])).reshape(-1, 4)


@pytest.fixture(scope='module')
def course():
    """Return a run whose head is where it should be but for 1 mm at 1 Hz, while goals leap."""
    tables, begin = Tables(), 1000.0
    for k in range(4000):
        time = 0.0101 * k
        goal = Pose(0.1 * (time // 6.0 % 2), 0.25, 0.0)
        reference = Pose(0.1 * abs(1.0 - time / 6.0 % 2.0), 0.25, 0.0)
        head = add(reference, Pose(*np.multiply((1.0, 0.1, 0.1), 1e-3 * math.sin(6.2832 * time))))
        rail = Pose(0.05 * math.sin(time), 0.01, 0.02)
        for topic, pose in ((HEAD_POSE, head), (REFERENCE, reference),
                            (END_EFFECTOR_POSE, compose(invert(rail), head))):
            tables.setdefault(topic, []).append((begin + time, *pose))
        if k % 100 == 0:
            tables.setdefault(GOAL_POSE, []).append((begin + time, *goal))
    return course_of(tables, 2.5)


def test_an_error_of_a_millimetre_is_one_in_figures_and_spectrum_while_goals_leap(course):
    assert 0.4 < course.settled.mean() < 0.7
    assert figures(course)['x']['residual_rms'] == pytest.approx(1e-3 / math.sqrt(2), rel=0.02)
    assert course.uncompensated[:, 1] == pytest.approx(0.01 + 0.02 * course.references[:, 0],
                                                       abs=1e-4)
    panel = pictures.spectrum(course, []).axes[0]
    frequencies, amplitude = panel.lines[1].get_data()
    assert frequencies[amplitude.argmax()] == pytest.approx(1.0, abs=0.03)
    assert amplitude.max() == pytest.approx(1.0, rel=0.15)  # between two bins
    assert amplitude[frequencies > 3.0].max() < 0.1  # mm, no leap of 100 mm


@pytest.mark.parametrize(('length', 'drawn'), [(0.352, True), (0.2, False)])
def test_before_and_after_shows_who_stands_still_and_who_compensates(course, length, drawn):
    panels = before_and_after(course, Geometry(length), Wall()).axes
    offsets = [[float(number) for number in re.findall(r'[+-][\d.]+', panel.get_title())]
               for panel in panels]
    assert len(panels) == 6
    assert offsets[1][0] < -40.0 and offsets[2][0] > 40.0  # mm, from 50 sin t and the yaw
    assert all(abs(number) <= 1.0 for panel in offsets[3:] for number in panel)
    assert all(bool(line.get_xdata().size) == drawn for line in panels[5].lines)


def test_without_a_goal_that_stood_all_samples_count(course):
    moving = course._replace(settled=np.zeros_like(course.settled))
    assert figures(moving)['x']['residual_rms'] == pytest.approx(1e-3 / math.sqrt(2), rel=0.02)


def test_an_axis_that_gives_way_has_no_attenuation_in_its_title(course):
    titles = [panel.get_title('left') for panel in pictures.time_courses(
        course, figures(course), ['y']).axes[::2]]
    assert ['dB' in title for title in titles] == [True, False, True]
    assert 'an offset from the goal is intended' in titles[1]


def test_run_with_too_few_samples_is_rejected():
    with pytest.raises(ManipulatorError, match='0 poses of the head and 0 goals are too few'):
        course_of(Tables(), 2.5)


def test_course_has_only_times_when_all_topics_were_collected():
    spans = {HEAD_POSE: (0.0, 1.0), END_EFFECTOR_POSE: (0.1, 0.9), REFERENCE: (0.2, 1.0),
             GOAL_POSE: (0.05, 0.1)}
    tables = Tables({topic: [(stamp, 0.0, 0.25, 0.0) for stamp in np.arange(begin, end, 0.01)]
                     for topic, (begin, end) in spans.items()})
    assert course_of(tables, 0.0).times[-1] == pytest.approx(0.9 - 0.2, abs=0.03)


def test_collector_keeps_valid_messages_once_in_order(ros):
    node = ros.node('collector')
    collector, heads = Collector(node), publisher(node, HEAD_POSE)
    ros.until(heads.get_subscription_count, 'the subscription of the collector')
    for stamp, x in ((3.0, math.nan), (2.0, 0.2), (1.0, 0.1), (2.0, 0.3)):
        heads.publish(pose_stamped('facade', stamp, Pose(x, 0.25, 0.0)))
    ros.until(lambda: len(collector.series[HEAD_POSE]) == 3, 'the valid messages')
    assert collector.table(HEAD_POSE)[:, :2].tolist() == [[1.0, 0.1], [2.0, 0.2]]


def test_error_of_the_head_is_taken_at_its_stamp(ros):
    collector = Collector(ros.node('collector'))
    assert collector.error() is None
    collector.series[REFERENCE].extend([(1.0, 0.0, 0.25, 0.0), (2.0, 0.1, 0.25, 0.0)])
    collector.series[HEAD_POSE].append((1.5, 0.051, 0.25, 0.01))
    assert collector.error() == pytest.approx((1e-3, 0.0, 0.01), abs=1e-9)


@pytest.mark.parametrize('share', [1.0, 0.6])
def test_a_spectrum_shows_a_sine_and_the_attenuation_what_became_of_it(share):
    times = np.arange(0.0, 40.0, 0.01)
    without = 3.0 * np.sin(2.0 * np.pi * 0.5 * times)
    counts = times % 6.0 < share * 6.0
    (frequencies, present), (_, before), (_, after) = (
        pictures.amplitudes(values, 0.01, used) for values, used in (
            (without, np.ones_like(counts)), (without, counts), (0.01 * without, counts)))
    assert frequencies[present.argmax()] == pytest.approx(0.5)
    assert present.max() == pytest.approx(3.0, rel=1e-3)
    bands, decibels = pictures.attenuation(frequencies, before, after, present)
    assert decibels == pytest.approx(np.full(len(bands), 40.0))
    assert bands.min() > 0.4 and bands.max() < 0.6  # nothing where there is no disturbance


def test_a_killed_demo_takes_its_nodes_with_it(start_process, tmp_path):
    process = start_process(DEMO, '--duration', '60', '--output', str(tmp_path / 'report'))
    wait_until(lambda: ' 0.0 s ' in process.log.read_text(), 'the first line', RUN_DEADLINE)
    nodes = children(process.pid)
    assert len(nodes) == 3
    os.kill(process.pid, signal.SIGKILL)
    wait_until(lambda: not any(Path(f'/proc/{pid}').exists() for pid in nodes), 'the nodes to end')


@pytest.mark.parametrize('arguments, message', [
    (('--duration', '0'), "'0' is not a number of seconds between 1 and 86400"),
    (('--duration', 'nan'), "'nan' is not a number of seconds between"),
    (('--duration', 'abc'), "argument --duration: 'abc' is not a number of seconds between"),
    (('--output', '/proc/nowhere'), '/proc/nowhere cannot be written'),
])
def test_bad_arguments_are_one_sentence_and_exit_status_2(start_process, arguments, message):
    process = start_process(DEMO, *arguments)
    wait_until(lambda: ended(process), 'the end of the demo')
    assert process.returncode == 2
    assert message in process.log.read_text()
    assert 'Traceback' not in process.log.read_text()


def test_drives_that_stop_end_the_demo_with_the_reason(start_process, tmp_path):
    process = start_process(DEMO, '--duration', '60', '--output', str(tmp_path / 'report'))
    wait_until(lambda: ' 0.0 s ' in process.log.read_text(), 'the first line', RUN_DEADLINE)
    driver = next(pid for pid in children(process.pid)
                  if b'start.driver' in Path(f'/proc/{pid}/cmdline').read_bytes())
    loop, = children(driver)
    os.kill(loop, signal.SIGSTOP)
    wait_until(lambda: Path(f'/proc/{loop}/stat').read_text().split()[2] == 'T', 'the freeze')
    time.sleep(FREEZE)
    os.kill(loop, signal.SIGCONT)
    wait_until(lambda: ended(process), 'the end of the demo', RUN_DEADLINE)
    assert process.returncode == 1
    assert re.search('demo: driver: stopped: .*; next: ', process.log.read_text())
