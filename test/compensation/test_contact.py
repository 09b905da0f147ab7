"""What the wall tells the head, checked and turned into shifts of the goal."""

import math

import pytest

from facade_manipulator.compensation.contact import Contact, LateralSettings
from facade_manipulator.compensation.impedance import ImpedanceSettings, YawImpedanceSettings
from facade_manipulator.compensation.pressing import PressMode, Surroundings
from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import Pose, Wrench

NOW = 1000.0
PRESSED = Wrench(3.0, -30.0, 0.5)
REFERENCE = Pose(0.1, 0.25, 0.3)
AROUND = Surroundings()


def contact():
    return Contact(LateralSettings(enabled=True), ImpedanceSettings(enabled=True),
                   YawImpedanceSettings(enabled=True))


def test_the_force_on_the_wall_is_what_presses_towards_it():
    felt = contact()
    felt.shift(NOW, NOW, 0.0, REFERENCE, AROUND)
    felt.add_wrench(NOW, NOW, PRESSED)
    assert felt.pressing.y.measured == pytest.approx(30.0 * math.cos(0.3) - 3.0 * math.sin(0.3))
    assert felt.pressing.theta.measured == -0.5


def test_without_contact_settings_the_reference_stays_as_it_is():
    felt = Contact(LateralSettings(), ImpedanceSettings(), YawImpedanceSettings())
    felt.add_wrench(NOW, NOW, PRESSED)
    felt.add_lateral_offset(NOW, NOW, 0.02)
    for k in range(1, 50):
        now = NOW + 0.01 * k
        shifted = felt.shift(now, now, 0.01, REFERENCE, AROUND)
    assert shifted == REFERENCE


def test_every_axis_is_shifted_by_its_own_measurement():
    felt = contact()
    for k in range(1, 500):
        now = NOW + 0.01 * k
        felt.add_wrench(now, now, Wrench(0.0, *((-5.0, 0.5) if k > 400 else (0.0, 1e-4 * k))))
        felt.add_lateral_offset(now, now, 0.02)
        shifted = felt.shift(now, now, 0.01, REFERENCE, AROUND)
    assert shifted.x > REFERENCE.x
    assert shifted.y < REFERENCE.y
    assert shifted.theta > REFERENCE.theta
    assert felt.present == pytest.approx([a - b for a, b in zip(shifted, REFERENCE, strict=True)])


def test_a_head_that_begins_on_the_wall_goes_back_before_it_looks_for_it():
    felt = contact()
    first_guess = felt.pressing.stiffness.value
    for k in range(1, 100):
        now = NOW + 0.01 * k
        felt.add_wrench(now, now, Wrench(0.0, -20.0 + 5.0 * math.sin(k), 0.0))
        felt.shift(now, now, 0.01, REFERENCE, AROUND)
    assert felt.pressing.mode is PressMode.RETRACTED
    assert 'N are measured before the wall is looked for' in felt.pressing.reason
    for k in range(100, 500):
        now = NOW + 0.01 * k
        felt.add_wrench(now, now, Wrench(0.0, -1e-3 * k, 0.0))
        felt.shift(now, now, 0.01, REFERENCE, AROUND)
    assert felt.pressing.mode is PressMode.SEARCHING
    assert felt.pressing.stiffness.value == first_guess


@pytest.mark.parametrize(('add', 'stamp', 'measured', 'reason'), [
    (Contact.add_wrench, NOW, Wrench(math.nan, 0.0, 0.0), 'not_finite'),
    (Contact.add_wrench, NOW, Wrench(0.0, 0.0, math.inf), 'not_finite'),
    (Contact.add_wrench, NOW - 0.5, PRESSED, 'stale'),
    (Contact.add_wrench, NOW + 0.5, PRESSED, 'future'),
    (Contact.add_lateral_offset, NOW, math.nan, 'not_finite'),
    (Contact.add_lateral_offset, NOW - 0.5, 0.0, 'stale'),
    (Contact.add_lateral_offset, NOW + 0.1, 0.0, 'future')])
def test_what_cannot_be_believed_is_rejected(add, stamp, measured, reason):
    with pytest.raises(InputError) as caught:
        add(contact(), NOW, stamp, measured)
    assert caught.value.reason == reason


def test_measurements_out_of_order_are_rejected_each_by_its_own_order():
    felt = contact()
    felt.add_wrench(NOW, NOW, PRESSED)
    felt.add_lateral_offset(NOW, NOW - 0.1, 0.0)
    with pytest.raises(InputError, match='older'):
        felt.add_wrench(NOW, NOW - 0.01, PRESSED)
    with pytest.raises(InputError, match='older'):
        felt.add_lateral_offset(NOW, NOW - 0.1, 0.0)
