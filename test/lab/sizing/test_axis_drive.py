"""Motor, gear and screw: torque from power, what binds, and tables that are their user's."""

from dataclasses import replace
import math

import numpy as np
import pytest

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.lab.sizing import axis_drive
from facade_manipulator.lab.sizing.axis_drive import AxisDrive, Duty, Motor
from facade_manipulator.lab.sizing.catalogue import read_motors, read_screws
from facade_manipulator.lab.sizing.demand import Demand, STEP
from facade_manipulator.lab.sizing.screw import BallScrew
from facade_manipulator.resources import config_path

TIMES = STEP * np.arange(1000)[:, None]
RATE, AMPLITUDE = math.tau * 0.5, np.array((0.1, 0.05, 0.02))
SPEED = AMPLITUDE * RATE * np.cos(RATE * TIMES)
DEMAND = Demand(
    np.zeros((1000, 3)), AMPLITUDE * np.sin(RATE * TIMES), SPEED,
    -RATE ** 2 * AMPLITUDE * np.sin(RATE * TIMES), 40.0 * np.sign(SPEED), (-0.3, 0.3))
DRIVE = AxisDrive(Motor('m'), 2.0, BallScrew('s'))
MOTORS, SCREWS = (config_path('sizing') / f'{name}.csv' for name in ('motors', 'screws'))


def test_without_losses_the_motors_power_is_that_of_the_carriage_and_of_what_turns():
    duty = Duty(efficiency=1.0)
    turning = math.tau * DRIVE.turns * DEMAND.speed
    shaft = DRIVE.screw.inertia(axis_drive.screw_length(DEMAND, duty)) / DRIVE.gear_ratio ** 2
    inertia = (DRIVE.motor.inertia + shaft) * (math.tau * DRIVE.turns) ** 2
    assert axis_drive.torques(DRIVE, DEMAND, duty) * turning == pytest.approx(
        DEMAND.power + inertia * DEMAND.acceleration * DEMAND.speed)


def test_a_gear_and_a_finer_lead_make_the_same_torque_of_the_load():
    light = replace(DRIVE.motor, inertia=0.0)
    still = DEMAND._replace(acceleration=np.zeros((1000, 3)))
    geared, fine = (
        axis_drive.torques(AxisDrive(light, ratio, BallScrew(lead=lead)), still, Duty())
        for ratio, lead in ((4.0, 0.02), (1.0, 0.005)))
    assert geared == pytest.approx(fine)
    assert np.abs(geared).max() == pytest.approx(40.0 * 0.005 / math.tau / 0.85)


def test_losses_help_to_brake():
    braking = DEMAND._replace(force=-DEMAND.force, acceleration=np.zeros((1000, 3)))
    duty = Duty(efficiency=0.8)
    driven = DEMAND._replace(acceleration=np.zeros((1000, 3)))
    assert np.abs(axis_drive.torques(DRIVE, driven, duty)).max() == pytest.approx(
        np.abs(axis_drive.torques(DRIVE, braking, duty)).max() / 0.8 ** 2)


@pytest.mark.parametrize(('what', 'binds'), [
    ({'rated_torque': 0.07}, 'rated torque of q1'), ({'peak_torque': 0.32}, 'peak torque of q1'),
    ({'peak_speed': 50.0}, 'motor speed of q1')])
def test_what_binds_of_a_motor_is_what_was_made_weak(what, binds):
    weak = DRIVE._replace(motor=replace(DRIVE.motor, **what))
    demand = DEMAND if 'peak_torque' not in what else DEMAND._replace(
        force=np.outer(np.arange(1000) == 5, (200.0, 0.0, 0.0)))
    strong, found = (axis_drive.binding(axis_drive.motor_margins(drive, demand, Duty()))
                     for drive in (DRIVE, weak))
    assert found[1] == binds and found[0] < strong[0]


@pytest.mark.parametrize(('screw', 'duty', 'binds'), [
    ({'speed_factor': 0.3}, {}, 'DN value of q1'), ({'core': 0.004}, {}, 'critical speed of q1'),
    ({'rating': 50.0}, {}, 'life of q1'),
    ({'core': 0.002, 'lead': 0.5}, {'mounting': 'fixed-free'}, 'buckling of q1')])
def test_what_binds_of_a_screw_is_what_was_made_weak(screw, duty, binds):
    margins = axis_drive.screw_margins(BallScrew(**screw), DEMAND, Duty(**duty))
    assert axis_drive.binding(margins)[1] == binds


def test_the_margin_of_the_life_is_the_factor_of_the_load_that_just_lasts():
    margin = axis_drive.screw_margins(DRIVE.screw, DEMAND, Duty())['life']
    heavier = DEMAND._replace(force=margin * DEMAND.force)
    assert axis_drive.life_hours(DRIVE.screw, heavier, Duty()) == pytest.approx(Duty().life)


def test_the_example_tables_are_read_in_si_units():
    motors, screws = read_motors(MOTORS), read_screws(SCREWS)
    by_name = {one.name: one for one in (*motors, *screws)}
    assert by_name['SGM7J-01A'].power == pytest.approx(100.0, rel=2e-3)  # "100 W"
    assert by_name['SGM7J-01A'].peak_speed == pytest.approx(100.0)
    # a rated angular acceleration of 48200 rad/s² and a power rate of 15.3 kW/s, says the manual
    motor = by_name['SGM7J-01A']
    assert motor.rated_torque / motor.inertia == pytest.approx(48200.0, rel=2e-3)
    assert motor.rated_torque ** 2 / motor.inertia == pytest.approx(15.3e3, rel=5e-3)
    assert by_name['R20-20K2'].lead == pytest.approx(0.02)
    assert by_name['R20-20K2'].speed_factor == pytest.approx(70.0 / 60.0)
    assert all(one.source for one in by_name.values())


HEADER = 'name,rated_torque_Nm,peak_torque_Nm,rated_speed_rpm,peak_speed_rpm,inertia_kgm2\n'


@pytest.mark.parametrize(('content', 'message'), [
    ('', 'has no rows below its header'), (HEADER, 'has no rows below its header'),
    ('name\na\n', 'has no column rated_torque_Nm'),
    (HEADER.replace('inertia_kgm2', 'inertia_kgcm2') + 'a,1,2,3000,6000,0\n',
     'column inertia_kgcm2 is not understood: did you mean'),
    (f'# a\n{HEADER}a,1,2,3000,6000,x\n', r"row 1 \(line 3\): inertia_kgm2 = 'x' is not a number"),
    (f'{HEADER}a,1,2,3000,6000\n', r"row 1 \(line 2\): inertia_kgm2 = '' is not a number"),
    (f'{HEADER}a,-1,2,3000,6000,0\n', r'line 2\): rated_torque = -1 N m is below its minimum'),
    (f'{HEADER}a,3,2,3000,6000,0\n', 'peak_torque = 2 N m is below rated_torque = 3 N m'),
    (f'{HEADER}a,1,2,nan,6000,0\n', 'rated_speed = nan is not a finite number')])
def test_a_table_that_is_none_is_told_with_line_value_bound_and_unit(tmp_path, content, message):
    file = tmp_path / 'motors.csv'
    file.write_text(content)
    with pytest.raises(ManipulatorError, match=message) as error:
        read_motors(file)
    assert str(file) in str(error.value)


def test_a_table_that_is_absent_is_told(tmp_path):
    with pytest.raises(ManipulatorError, match='screws.csv cannot be read'):
        read_screws(tmp_path / 'screws.csv')
