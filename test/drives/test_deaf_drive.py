"""A drive that receives SDO but no RPDO: the control thread takes its power by SDO."""

from __future__ import annotations

from bus_world import SETTINGS
from drive_faults import at_rest, in_motion
import pytest

from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.states import Power, State

LONGEST = 0.7  # s: 0.1 s until it is found, the ramp, and the same again for the power


def deafen(rig, number=1):
    rig.drives[number].is_deaf = True


def time_until_off(rig, number=1):
    """Return for how long the drive still has power [s], by the cycles of the controller."""
    def cycles():
        return rig.snapshot.cycle.cycles

    begin = cycles()
    rig.until(lambda: rig.snapshot.axes[number].power is Power.CONFIRMED_OFF
               or (cycles() - begin) * SETTINGS.period > 5.0)
    return (cycles() - begin) * SETTINGS.period


@pytest.mark.parametrize('situation', [at_rest, in_motion])
@pytest.mark.parametrize('number', range(3))
def test_stop_takes_power_from_drive_deaf_to_rpdo(rig, situation, number):
    situation(rig)
    deafen(rig, number)
    rig.controller.stop('enough')
    assert time_until_off(rig, number) < LONGEST
    assert f'q{number + 1} shows no effect of controlword 0002h in its RPDO' in rig.all_causes
    assert 'cleanup, configure, home, activate' in rig.snapshot.next_step
    assert 'confirmed that their power is off' in rig.request('cleanup')


def test_drive_deaf_since_the_stop_loses_power(rig):
    at_rest(rig)
    rig.controller.stop('enough')
    rig.until(lambda: rig.state is ControllerState.STOPPED)
    rig.until(lambda: rig.drive_states == [State.QUICK_STOP_ACTIVE] * 3)
    deafen(rig)
    assert 'controlword 0000h' in rig.rejection('clear_faults')
    assert time_until_off(rig) < LONGEST
    assert rig.state is ControllerState.STOPPED
