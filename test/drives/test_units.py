import dataclasses
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.units import COUNTS, VELOCITY_UNITS

SCALES = st.builds(
    AxisSettings,
    pulses_per_revolution=st.integers(1, 5000),
    gear_ratio=st.floats(0.5, 50.0),
    lead=st.floats(0.002, 0.05),
    direction=st.sampled_from((-1, 1)),
    rated_torque=st.floats(0.01, 5.0),
    efficiency=st.floats(0.1, 1.0),
    velocity_unit=st.sampled_from(tuple(VELOCITY_UNITS)),
)


# CiA 402-2, 60A9h: prefix, unit, per what
COUNTED = {0x01: 'metre', 0xB4: 'revolution', 0xB5: 'count'}
SECONDS = {0x03: 1.0, 0x47: 60.0}


@pytest.mark.parametrize('unit', VELOCITY_UNITS.values(), ids=VELOCITY_UNITS)
def test_unit_code_matches_the_size_of_the_unit(unit):
    code = unit.velocity.to_bytes(4, 'big')
    prefix = int.from_bytes(code[:1], 'big', signed=True)
    assert unit.counted == COUNTED[code[1]]
    assert unit.factor == pytest.approx(SECONDS[code[2]] * 10.0**-prefix)


# 60AAh by 60A9h where it is not the unit and square second: rpm per second, as in an EPOS4
PER_SECOND = {0xB447: 0xC003}


@pytest.mark.parametrize('unit', VELOCITY_UNITS.values(), ids=VELOCITY_UNITS)
def test_acceleration_code_is_that_of_the_unit_per_second(unit):
    prefix, speed = unit.velocity >> 24, unit.velocity >> 8 & 0xFFFF
    square_second = speed & 0xFF00 | 0x57
    assert unit.acceleration == prefix << 24 | PER_SECOND.get(speed, square_second) << 8


def test_unit_of_positions_is_the_count():
    """CiA 402-2, 60A8h: no prefix, and the unit increment."""
    assert COUNTS == 0x00B50000


@given(SCALES, st.integers(-1_000_000, 1_000_000))
def test_counts_survive_conversion_to_metres_exactly(scale, counts):
    assert scale.to_counts(scale.to_metres(counts)) == counts


@given(SCALES, st.floats(1e-3, 1.0))
def test_direction_inverts_position_speed_and_force(scale, value):
    turned = dataclasses.replace(scale, direction=-scale.direction)
    assert turned.to_counts(value) == -scale.to_counts(value)
    assert turned.si_per_unit == tuple(-unit for unit in scale.si_per_unit)


def test_prototype_has_the_published_counts_and_force():
    scale = AxisSettings(
        pulses_per_revolution=500,
        gear_ratio=4.3,
        lead=0.02,
        rated_torque=0.0545,
        efficiency=0.8,
        velocity_unit='rpm',
    )
    assert scale.counts_per_metre == pytest.approx(430_000)
    torque = 0.8 * 0.0545 * 4.3  # N m, at the screw
    assert 1000 * scale.si_per_unit.force == pytest.approx(2 * math.pi * torque / 0.02)
    assert scale.si_per_unit.velocity * 6450 == pytest.approx(0.5)
