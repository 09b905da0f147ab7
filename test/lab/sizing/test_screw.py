"""Ball screws against Euler, catalogues and worked examples."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.lab.sizing import screw

INCH, MINUTE = 0.0254, 60.0


@pytest.mark.parametrize(('mounting', 'shares', 'cautious'), [
    ('fixed-fixed', (1.0, 1.0), 1.0), ('fixed-supported', (0.692, 0.5), 1.0),
    ('supported-supported', (0.446, 0.25), 1.0), ('fixed-free', (0.147, 0.0625), 0.937)])
def test_a_shaft_whirls_and_buckles_where_a_catalogue_says(mounting, shares, cautious):
    """
    HIWIN BS-08-2-EN, F 3.23 to 3.27: mm, N, 1/min; E there is 2.1e5 N/mm².

    A beam that is held at one end alone whirls at 0.157 of one held at both; 0.147 stands there.
    """
    core, length = 17.1, 1100.0
    whirl, buckle = 2.71e8 * shares[0] * core / length ** 2, (
        4.072e5 * shares[1] * core ** 4 / length ** 2)
    shaft = core / 1e3, length / 1e3, mounting
    assert MINUTE * screw.critical_speed(*shaft) == pytest.approx(whirl / cautious, rel=0.015)
    assert screw.buckling_load(*shaft) == pytest.approx(buckle, rel=0.02)


@pytest.mark.parametrize(('mounting', 'factor', 'permitted'), [
    ('fixed-fixed', 20.3, 21.9), ('fixed-supported', 10.2, 15.1),
    ('supported-supported', 5.1, 9.7), ('fixed-free', 1.3, 3.4)])
def test_another_catalogues_permitted_values_are_half_and_four_fifths(
        mounting, factor, permitted):
    """HSK, screw shaft design: m d⁴/L² 1e4 N; engineersedge.com: f d/L² 1e7 1/min (in mm)."""
    core, length = 12.5, 800.0
    shaft = core / 1e3, length / 1e3, mounting
    assert 0.5 * screw.buckling_load(*shaft) == pytest.approx(
        factor * core ** 4 / length ** 2 * 1e4, rel=0.05)
    assert 0.8 * MINUTE * screw.critical_speed(*shaft) == pytest.approx(
        permitted * core / length ** 2 * 1e7, rel=0.015)


@pytest.mark.parametrize(('mounting', 'hertz'), [
    ('fixed-fixed', 18.0), ('supported-supported', 8.0)])
def test_the_example_of_100_inches(mounting, hertz):
    """"10 steps to achieve optimal ball screw selection": 1 in core, 100 in, 18 and 8 Hz."""
    assert screw.critical_speed(INCH, 100.0 * INCH, mounting) == pytest.approx(hertz, abs=0.5)


def test_the_example_of_20000_hours():
    """MITCalc, ball screws: 1000 N, factor 1.2, 2400/min, 20000 h need a rating of 17073.1 N."""
    revolutions = 2400.0 * MINUTE * 20000.0
    assert screw.life(17073.1, (1.2 * 1000.0, 0.0)) == pytest.approx(revolutions, rel=1e-5)


@given(st.floats(10.0, 1e3), st.floats(10.0, 1e3), st.floats(1.1, 5.0))
def test_life_falls_with_the_cube_of_the_load_and_with_the_other_flank(push, pull, factor):
    rating = 1e4
    assert screw.life(rating, (factor * push, factor * pull)) == pytest.approx(
        screw.life(rating, (push, pull)) / factor ** 3)
    assert screw.life(rating, (push, pull)) < min(
        screw.life(rating, (push, 0.0)), screw.life(rating, (0.0, pull)))
    # ISO 3408-5: L = (L1^(-10/9) + L2^(-10/9))^(-9/10)
    one, other = (1e6 * (rating / load) ** 3 for load in (push, pull))
    assert screw.life(rating, (push, pull)) == pytest.approx(
        (one ** (-10 / 9) + other ** (-10 / 9)) ** -0.9)


def test_the_mean_load_is_of_the_way_and_of_each_flank():
    """NSK and HIWIN F 3.9: (Σ F³ n t / Σ n t)^(1/3)."""
    push, pull = screw.mean_loads(np.array([100.0, 300.0, -200.0]), np.array([1.0, 0.5, -0.5]))
    assert push == pytest.approx(((100.0 ** 3 * 1.0 + 300.0 ** 3 * 0.5) / 2.0) ** (1 / 3))
    assert pull == pytest.approx((200.0 ** 3 * 0.5 / 2.0) ** (1 / 3))
    assert screw.mean_loads(np.array([50.0]), np.array([0.0])) == (0.0, 0.0)
    assert screw.life(1e4, (0.0, 0.0)) == float('inf')


def test_longer_screws_whirl_and_buckle_earlier_and_thicker_ones_later():
    for mounting in screw.MOUNTINGS:
        assert screw.critical_speed(0.02, 2.0, mounting) == pytest.approx(
            screw.critical_speed(0.02, 1.0, mounting) / 4.0)
        assert screw.buckling_load(0.02, 1.0, mounting) == pytest.approx(
            16.0 * screw.buckling_load(0.01, 1.0, mounting))
