"""Finding oscillations in a window of measurements."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.prediction.spectrum import fit_oscillations


def window(duration, *sines, offset=0.0, noise=0.0, rate=50.0, seed=0):
    random = np.random.default_rng(seed)
    count = int(duration * rate)
    times = 100.0 + (np.arange(count) + random.uniform(-0.2, 0.2, count)) / rate
    values = offset + noise * random.standard_normal(len(times))
    for amplitude, frequency, phase in sines:
        values += amplitude * np.sin(2.0 * np.pi * frequency * times + phase)
    return times, values


@given(st.floats(0.15, 5.0), st.floats(0.0, 6.28), st.floats(-0.2, 0.2))
def test_one_oscillation_is_found_with_its_phase(frequency, phase, offset):
    times, values = window(20.0, (0.05, frequency, phase), offset=offset)
    fit = fit_oscillations(times, values)
    assert fit.frequencies[0] / (2.0 * np.pi) == pytest.approx(frequency, abs=0.01)
    assert fit.explained > 0.98
    assert fit.offset + sum(fit.places) == pytest.approx(values[-1], abs=0.012)


def test_two_oscillations_are_told_apart():
    times, values = window(20.0, (0.1, 0.11, 0.3), (0.02, 0.3, 1.0), noise=1e-3)
    fit = fit_oscillations(times, values)
    assert np.array(fit.frequencies) / (2.0 * np.pi) == pytest.approx([0.11, 0.3], abs=0.015)
    assert fit.explained > 0.99


def test_noise_beside_one_oscillation_is_no_second_one():
    times, values = window(20.0, (0.05, 0.5, 0.3), noise=1e-3)
    assert len(fit_oscillations(times, values).frequencies) == 1


def test_noise_alone_is_hardly_explained():
    times, values = window(20.0, noise=1e-3)
    assert fit_oscillations(times, values).explained < 0.5


@pytest.mark.parametrize(('duration', 'frequency'), [(1.0, 2.0), (8.0, 0.08)])
def test_a_window_too_short_to_tell_gives_nothing(duration, frequency):
    assert fit_oscillations(*window(duration, (0.05, frequency, 0.0))) is None
