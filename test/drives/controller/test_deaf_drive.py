"""A drive that receives SDO but no RPDO: the control thread takes its power by SDO."""

from __future__ import annotations

from drive_rig import at_rest, moving, SETTINGS
import pytest
from support import wait_until

from facade_manipulator.drives.cia402.states import Power, State
from facade_manipulator.drives.controller.snapshot import ControllerState

LONGEST = 0.7  # s: 0.1 s until it is found, the ramp, and the same again for the power


def deafen(rig, number=1):
    with rig.simulator.access() as drives:
        drives[number].is_deaf = True


def time_until_off(rig, number=1):
    """Return for how long the drive still has power [s], by the cycles of the controller."""
    def cycles():
        return rig.controller.snapshot().cycle.cycles

    begin = cycles()
    wait_until(lambda: rig.controller.snapshot().axes[number].power is Power.CONFIRMED_OFF
               or (cycles() - begin) * SETTINGS.period > 5.0, 'the end of the power')
    return (cycles() - begin) * SETTINGS.period


@pytest.mark.parametrize('situation', [at_rest, moving])
@pytest.mark.parametrize('number', range(3))
def test_stop_takes_power_from_drive_deaf_to_rpdo(rig, situation, number):
    situation(rig)
    deafen(rig, number)
    rig.controller.stop('enough')
    assert time_until_off(rig, number) < LONGEST
    assert f'q{number + 1} shows no effect of controlword 0002h in its RPDO' in rig.all_causes
    assert 'cleanup, configure, home, activate' in rig.controller.snapshot().next_step
    assert 'confirmed that their power is off' in rig.do('cleanup')


def test_drive_deaf_since_the_stop_loses_power_when_faults_are_cleared(rig):
    at_rest(rig)
    rig.controller.stop('enough')
    rig.until(ControllerState.STOPPED)
    wait_until(lambda: rig.drive_states == [State.QUICK_STOP_ACTIVE] * 3, 'the quick stop')
    deafen(rig)
    assert 'controlword 0000h' in rig.rejection('clear_faults')
    assert time_until_off(rig) < LONGEST
    assert rig.state is ControllerState.STOPPED


def test_sdo_worker_that_waits_does_not_delay_the_stop_by_sdo(rig):
    at_rest(rig)
    deafen(rig)
    is_off = []
    job = rig.controller._session.worker.submit(wait_until, lambda: is_off, 'the power off')
    rig.controller.stop('enough')
    assert time_until_off(rig) < LONGEST and not job.done()
    is_off.append(True)


def test_drive_that_obeys_its_rpdos_is_sent_no_controlword_by_sdo(rig):
    at_rest(rig)
    rig.frames()
    rig.controller.stop('enough')
    rig.until(ControllerState.STOPPED)
    rig.do('clear_faults')
    writes = [one for one in rig.frames()
              if one.arbitration_id in (0x601, 0x602, 0x603) and one.data[1:4] == b'\x40\x60\x00']
    assert not writes
