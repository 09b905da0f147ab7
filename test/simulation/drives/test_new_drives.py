"""Objects that a drive stores, and inputs that it inverts."""

from __future__ import annotations

from drive_bench import Bench
import pytest

SAVE, LOAD = int.from_bytes(b'save', 'little'), int.from_bytes(b'load', 'little')


def test_only_stored_objects_survive_a_power_cut():
    bench = Bench().boot()
    assert bench.write(0x6084, 0, 1234) is None
    assert bench.write(0x1010, 1, SAVE) is None
    assert bench.write(0x6085, 0, 4321) is None
    default = bench.drive.objects.variables[0x6085, 0].default
    bench.drive.reboot()
    bench.boot()
    assert (bench.read(0x6084), bench.read(0x6085)) == (1234, default)
    assert bench.write(0x1011, 1, LOAD) is None
    assert bench.read(0x6084) == 1234
    bench.drive.reboot()
    assert bench.boot().read(0x6084) != 1234


@pytest.mark.parametrize(('opens', 'polarity', 'on'), [
    (False, 0, True), (True, 0, False), (True, 4, True)])
def test_object_inverts_the_home_switch(opens, polarity, on):
    bench = Bench(home_switch_opens=opens).boot()
    bench.write(0x3141, 2, polarity)
    assert bool(bench.read(0x60FD) & 4) is on
