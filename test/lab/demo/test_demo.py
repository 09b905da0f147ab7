"""The demo as people run it: a process, its report, and what is left after Ctrl-C."""

import json
import math
import os
from pathlib import Path
import re
import signal
import time
from types import SimpleNamespace

import numpy as np
import pytest
from support import children, wait_until

from facade_manipulator.blackbox import Received, RecordedRun
from facade_manipulator.errors import RecordError
from facade_manipulator.kinematics import add, compose, Geometry, invert, Pose
from facade_manipulator.lab.demo.__main__ import Demo
from facade_manipulator.lab.demo.animation import before_and_after
from facade_manipulator.lab.demo.course import course_of, HEAD
from facade_manipulator.lab.gondola import figures, load_scenario, pictures
from facade_manipulator.messages import planar_numbers, stamp_numbers

DEMO = 'facade_manipulator.lab.demo'
SETTLED = 10.0
RUN_DEADLINE = 90.0
FREEZE = 1.0  # s, far beyond what drives forgive
LARGEST_ANIMATION = 2_000_000


def ended(process):
    return process.poll() is not None


def test_a_run_compensates_and_leaves_its_report(start_process, tmp_path):
    process = start_process(DEMO, '--duration', str(SETTLED), '--output', str(tmp_path / 'report'))
    wait_until(lambda: ended(process), 'the end of the demo', RUN_DEADLINE)
    text = process.log.read_text()
    assert process.returncode == 0, text
    summary = json.loads((tmp_path / 'report' / 'summary.json').read_text())
    for axis, least in (('x', 20.0), ('y', 12.0), ('theta', 12.0)):
        assert summary['axes'][axis]['attenuation_db'] >= least, text
        assert summary['axes'][axis]['residual_rms'] < summary['axes'][axis]['disturbance_rms']
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


@pytest.mark.parametrize('moment', ['starting', 'driver: home', ' 0.0 s '])
def test_ctrl_c_at_any_moment_leaves_nothing_running(start_process, tmp_path, moment):
    process = start_process(DEMO, '--duration', '60', '--output', str(tmp_path / 'report'))
    wait_until(lambda: moment in process.log.read_text(), f'"{moment}"', RUN_DEADLINE)
    nodes = children(process.pid)
    os.kill(process.pid, signal.SIGINT)
    wait_until(lambda: ended(process), 'the end of the demo')
    text = process.log.read_text()
    assert process.returncode == 130, text
    assert 'interrupted: drives stopped, nodes ended' in text and 'Traceback' not in text
    assert [pid for pid in nodes if Path(f'/proc/{pid}').exists()] == []


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


def test_a_plan_is_followed_from_goal_to_goal_until_the_time_is_over():
    mission = load_scenario('window').mission
    sent, printed, times = [], [], iter([9.0, 8.0, 5.0, 4.0, 2.0, 1.0, 0.5, -0.1])
    demo = SimpleNamespace(
        scenario=SimpleNamespace(mission=mission), console=SimpleNamespace(print=printed.append),
        client=SimpleNamespace(go_to=lambda goal, on_progress: sent.append(goal)))
    Demo._follow_plan(demo, lambda *_: next(times))
    assert sent == [*mission.plan, *mission.plan][:7] and len(mission.plan) == 5
    assert printed == ['7 goals reached, one after the other']


def message(time, pose):
    sec, nanosec = stamp_numbers(time)
    x, y, z, qx, qy, qz, qw = planar_numbers(Pose(*pose))
    return Received(time, SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec)),
        pose=SimpleNamespace(position=SimpleNamespace(x=x, y=y, z=z),
                             orientation=SimpleNamespace(x=qx, y=qy, z=qz, w=qw))))


@pytest.fixture(scope='module')
def course():
    """Return a run whose head is where it should be but for 1 mm at 1 Hz, while goals leap."""
    run, begin = RecordedRun(begin=1000.0, end=1040.0), 1000.0
    for k in range(4000):
        time = 0.0101 * k
        goal = Pose(0.1 * (time // 6.0 % 2), 0.25, 0.0)
        reference = Pose(0.1 * abs(1.0 - time / 6.0 % 2.0), 0.25, 0.0)
        head = add(reference, Pose(*np.multiply((1.0, 0.1, 0.1), 1e-3 * math.sin(6.2832 * time))))
        rail = Pose(0.05 * math.sin(time), 0.01, 0.02)
        if k % 100 == 0:
            run.topics['goal_pose'].append(message(begin + time, goal))
        for topic, pose in ((HEAD, head), ('compensator/reference', reference),
                            ('end_effector_pose', compose(invert(rail), head))):
            run.topics[topic].append(message(begin + time, pose))
    return course_of(run, 2.5)


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
    panels = before_and_after(course, Geometry(length), load_scenario('gusty').facade).axes
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
    assert 'its shift from the goal is meant' in titles[1]


def test_too_short_a_run_is_said():
    with pytest.raises(RecordError, match='0 poses of the head and 0 goals are too few'):
        course_of(RecordedRun(), 2.5)


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
    assert len(nodes) == 4
    os.kill(process.pid, signal.SIGKILL)
    wait_until(lambda: not any(Path(f'/proc/{pid}').exists() for pid in nodes), 'the nodes to end')


@pytest.mark.parametrize('arguments, message', [
    (('--duration', '0'), '0 s is not between 1 s and 86400 s'),
    (('--duration', 'nan'), 'nan s is not between'),
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
