"""Recorded disturbances."""

import math

import numpy as np
import pytest

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.lab.gondola.motion import load_recording, recording

TIMES = np.arange(0.0, 10.0, 0.02)
POSES = np.column_stack([0.1 * np.sin(TIMES), 0.01 * np.cos(TIMES), 0.02 * np.sin(2 * TIMES)])


def test_what_was_recorded_is_played_back():
    motion = recording(TIMES + 500.0, POSES)
    for time in (0.0, 0.013, 3.337, 9.9):
        expected = (0.1 * math.sin(time), 0.01 * math.cos(time), 0.02 * math.sin(2 * time))
        assert motion(time) == pytest.approx(expected, abs=1e-4)


def test_at_its_end_it_is_played_backwards_without_a_step():
    motion = recording(TIMES, POSES)
    places = np.array([motion(time) for time in np.arange(0.0, 45.0, 0.005)])
    assert abs(np.diff(places, axis=0)).max() < 1e-3
    assert motion(19.9) == pytest.approx(tuple(motion(0.06)), abs=5e-3)


def write(path, text):
    path.write_text(text)
    return path


def test_a_file_is_read(tmp_path):
    rows = '\n'.join(','.join(map(str, (time, *pose))) for time, pose in zip(
        TIMES, POSES, strict=True))
    path = write(tmp_path / 'wind.csv', f'time,x,y,theta\n{rows}\n')
    assert load_recording(path)(1.0).x == pytest.approx(0.1 * math.sin(1.0), abs=1e-4)


def test_columns_may_name_their_units(tmp_path):
    path = write(tmp_path / 'wind.csv', 'time;x_mm;y_mm;theta_deg\n0;10;0;0\n1;10,5;0;180\n')
    assert load_recording(path)(0.0) == pytest.approx((0.01, 0.0, 0.0))


@pytest.mark.parametrize(('text', 'message'), [
    ('time,x,y\n0,0,0\n', 'no column theta'),
    ('', 'has no rows below its header'),
    ('time,x,y,theta\n0,0,0,0\n', '2 samples'),
    ('time,x,y,theta\n0,0,0,0\n1,a,0,0\n', r'row 2 \(line 3\): x = .a. is not a number'),
    ('time,x,y,theta\n0,0,0,0\n1,nan,0,0\n', r'row 2 \(line 3\): x = .nan. is not a number'),
    ('time,x,y,theta\n0,0,0,0\n1,0,0,0\n1,0,0,0\n', 'must ascend'),
])
def test_a_file_that_is_no_recording_is_rejected(tmp_path, text, message):
    with pytest.raises(ManipulatorError, match=message):
        load_recording(write(tmp_path / 'bad.csv', text))


def test_a_file_that_is_not_there_is_rejected(tmp_path):
    with pytest.raises(ManipulatorError, match='cannot be read'):
        load_recording(tmp_path / 'nothing.csv')
