"""Load of the bus: accepted up to one half, with the figures of the literature."""

from dataclasses import replace

import pytest

from facade_manipulator.drives.bus_load import bus_load, check_bus_load, longest_frame
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.errors import ParameterError

PROFILES = 3 * (load_profile('simulated'),)


def settings_of(rate):
    return replace(ControllerSettings(), rate=rate)


@pytest.mark.parametrize(('size', 'bits'), [(0, 55), (1, 65), (8, 135)])
def test_longest_frame_has_the_bits_of_tindell(size, bits):
    assert longest_frame(size) == bits


@pytest.mark.parametrize(('rate', 'percent'), [(100, 16), (200, 31)])
def test_load_at_1_mbit_s_is_that_of_the_design(rate, percent):
    load = bus_load(settings_of(rate), 1_000_000, PROFILES)
    assert 100.0 * load == pytest.approx(percent, abs=0.5)


@pytest.mark.parametrize('rate', [100, 125, 200, 250, 500])
def test_usual_rates_are_accepted_at_1_mbit_s(rate):
    check_bus_load(settings_of(rate), 1_000_000, PROFILES)


@pytest.mark.parametrize(
    ('rate', 'bitrate', 'percent'),
    [(100, 125_000, 126), (100, 250_000, 63), (500, 500_000, 97)],
)
def test_rejection_names_load_rate_bit_rate_and_next_step(rate, bitrate, percent):
    with pytest.raises(ParameterError) as caught:
        check_bus_load(settings_of(rate), bitrate, PROFILES)
    assert str(caught.value) == (
        f'bus load = {percent} % at controller.rate = {rate} Hz and bus.bitrate = {bitrate} bit/s '
        'is above the limit 50 %; next: increase the bit rate, reduce controller.rate, or map '
        'fewer objects in the profile'
    )
