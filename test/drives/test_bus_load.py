"""How much of the bus the cycle takes at worst, and how often each PDO is sent."""

import pytest

from facade_manipulator.canopen.pdo import PDO_MAP
from facade_manipulator.drives.bus_load import check_bus_load, frame_bits, transmission_type
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.errors import ParameterError

MEGABIT = 1_000_000


@pytest.mark.parametrize(('length', 'bits'), [(8, 135), (7, 125), (1, 65), (0, 55)])
def test_longest_frame_has_its_stuff_bits(length, bits):
    assert frame_bits(length) == bits


@pytest.mark.parametrize(('rate', 'load'), [(100, 0.15725), (200, 0.3093), (500, 0.486)])
def test_bus_load_is_as_designed(rate, load):
    """At 100 Hz SYNC 5500 bit/s, PDOs 119 550, heartbeats 5200, SDO 27 000: one by one."""
    assert check_bus_load(ControllerSettings(rate=rate), MEGABIT) == pytest.approx(load, abs=1e-6)


@pytest.mark.parametrize('rate', [10, 50, 100, 125, 200, 250, 500])
def test_every_rate_fits_one_megabit(rate):
    settings = ControllerSettings(rate=rate)
    assert check_bus_load(settings, MEGABIT) <= 0.5
    assert all(1 <= transmission_type(pdo, rate) <= 240 for pdo in PDO_MAP)


def test_slow_bus_is_rejected_with_both_figures():
    with pytest.raises(ParameterError, match=r'bus load = 63 % at 100 Hz.* 50 %'):
        check_bus_load(ControllerSettings(), 250_000)
