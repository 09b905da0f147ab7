"""Carriages that a user pushes and measures by lines of text."""

import pytest
from simulation.drives.bench import Bench, CPM

from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.errors import DriveStateError, ParameterError
from facade_manipulator.simulation.drives.drive import SimulatedDrive
from facade_manipulator.simulation.drives.hand import act


@pytest.mark.parametrize('direction', [1, -1])
@pytest.mark.parametrize('line', ['push q1 50', 'push q1 +50 mm', ' PUSH Q1 50mm'])
def test_encoder_follows_a_push_without_power(line, direction):
    drive = SimulatedDrive(AxisSettings(direction=direction, home_position=0.1))
    drive.advance(1.0)
    start = drive.motor.counts
    assert act(line, {'q1': drive}) == 'q1 is pushed from +100.0 to +150.0 mm'
    drive.advance(2.0)
    assert drive.motor.counts - start == pytest.approx(direction * 0.05 * CPM, abs=1)
    assert act('ruler', {'q1': drive}) == 'q1 +150.0 mm from the middle of the rail'
    assert not drive.axis.is_moving


def test_push_ends_when_the_power_is_on():
    bench = Bench().configure()
    act('push q1 300', {'q1': bench.drive})
    bench.wait(0.5)
    bench.enable()
    assert not bench.drive.motor.is_pushed
    bench.cycle(100)
    assert bench.status.position_counts == pytest.approx(bench.target, abs=1)
    assert bench.target < 0.1 * CPM  # of the 0.3 m that were to come


def test_push_with_power_is_rejected_and_moves_nothing():
    bench = Bench().configure().enable()
    with pytest.raises(DriveStateError, match='has power .operation enabled.*; next: '):
        act('push q1 50', {'q1': bench.drive})
    bench.cycle(50)
    assert bench.drive.motor.position == pytest.approx(0.0, abs=1.0)


@pytest.mark.parametrize(
    'line, problem',
    [
        ('pull q1 50', 'pull q1 50 rejected: it is not a command'),
        ('push q1', 'push q1 rejected: it is not a command'),
        ('push q4 50', 'push q4 50 rejected: there is no carriage q4'),
        (
            'push q1 far',
            'push q1 far rejected: far is not a distance of at least 0.1 mm',
        ),
        ('push q1 nan', 'nan is not a distance'),
        ('push q1 inf', 'inf is not a distance'),
        ('push q1 5 cm', '5cm is not a distance'),
        ('push q1 0.05', '0.05 is not a distance of at least 0.1 mm'),
        ('push q1 600', 'it would end at +600.0 mm, beyond the end stop at +560 mm'),
        ('push q1 -561', 'it would end at -561.0 mm, beyond the end stop at -560 mm'),
    ],
)
def test_wrong_line_is_rejected_with_the_next_step(line, problem):
    drive = SimulatedDrive(AxisSettings(home_position=0.0))
    with pytest.raises(ParameterError) as error:
        act(line, {'q1': drive})
    assert problem in str(error.value)
    assert str(error.value).count('; next: ') == 1
    assert not drive.axis.is_moving
