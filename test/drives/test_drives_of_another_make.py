"""What the driver and drives of independent make owe each other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from drive_rig import axes_with, PATIENCE, Rig, SETTINGS
import pytest
from support import wait_until

# ruff: noqa: E402  # what follows needs the stack
pytest.importorskip('durand', reason='the CANopen stack of the foreign drives is not installed')
pytestmark = pytest.mark.realtime
from foreign_drives import ENABLED, FOLLOWING_ERROR, ForeignDrives, LOST_HEARTBEAT, NAME, PDOS

from facade_manipulator.drives.controller_state import ControllerState


class ForeignRig(Rig):
    """A drive controller on three drives of independent make."""

    def __init__(self, directory: Path, channel: str) -> None:
        super().__init__(channel, settings=replace(SETTINGS, rate=20), axes=axes_with(
            directory, 'generic_cia402', pdos=PDOS))

    def _start_drives(self) -> None:
        self.simulator = ForeignDrives(self._new_bus, (1000, 2000, 3000))
        self.drives = self.simulator.drives


@pytest.fixture
def rig(tmp_path, request):
    made = ForeignRig(tmp_path, request.node.name)
    yield made
    made.close()


def test_they_are_configured_homed_and_moved(rig):
    rig.do('configure', 'home')
    axes = rig.controller.snapshot().axes
    assert [axis.position for axis in axes] == pytest.approx([-0.1, 0.1, 0.0], abs=1e-4)
    rig.source.speed = 0.05
    rig.do('activate')
    wait_until(lambda: rig.controller.snapshot().axes[2].position > 0.01, 'motion')
    assert [drive.state for drive in rig.drives] == [ENABLED] * 3
    assert [axis.force for axis in rig.controller.snapshot().axes] == [None] * 3
    rig.do('deactivate', 'cleanup')
    wait_until(lambda: not any(drive.objects.read(0x1016, 1) for drive in rig.drives),
               'drives that miss no master')


def test_an_emergency_message_of_one_stops_all_and_is_cleared(rig):
    rig.do('configure', 'home', 'activate')
    rig.drives[1].fail(FOLLOWING_ERROR)
    wait_until(lambda: rig.state is ControllerState.STOPPED, 'the stop')
    wait_until(lambda: ENABLED not in [drive.state for drive in rig.drives], 'all to stop')
    assert 'q2 (node 2): the following error' in rig.controller.snapshot().cause
    rig.do('clear_faults', 'activate')


def test_a_node_that_somebody_stops_is_brought_back(rig):
    rig.do('configure', 'home')
    rig.forge(0, bytes([2, 3]))
    wait_until(lambda: rig.state is ControllerState.STOPPED, 'the stop')
    rig.do('clear_faults', 'activate')


def test_a_node_that_restarts_is_noticed_by_its_boot_up_message(rig):
    rig.do('configure', 'home')
    rig.forge(0, bytes([129, 1]))
    wait_until(lambda: 'restarted' in rig.controller.snapshot().cause, 'the boot-up message')
    assert rig.controller.snapshot().unhomed == ('q1',)
    rig.do('cleanup', 'configure', 'home', 'activate')


def test_a_dead_master_is_missed_by_its_heartbeat(rig):
    rig.do('configure', 'home', 'activate')
    rig.controller._session.exchange.transmits = False
    wait_until(lambda: ENABLED not in [drive.state for drive in rig.drives], 'all to stop')
    wait_until(lambda: rig.state is ControllerState.STOPPED, 'the stop')
    assert f'{LOST_HEARTBEAT:04X}h' in str(rig.controller.snapshot().causes)


def test_long_objects_go_in_segments_both_ways(rig):
    rig.do('configure')
    session = rig.controller._session
    objects = session.commissioning._drives[1].objects
    assert session.worker.submit(objects.read, 0x1008, 0).result(PATIENCE) == NAME
    text = bytes(range(200))
    session.worker.submit(objects.write, 0x2100, 0, text).result(PATIENCE)
    assert rig.drives[1].objects.read(0x2100, 0) == text
