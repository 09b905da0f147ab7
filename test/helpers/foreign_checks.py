"""What the driver and drives of independent make owe each other, on any bus."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import can
from drive_rig import SETTINGS as FAST
from drive_rig import Source
from foreign_drives import ENABLED, FOLLOWING_ERROR, ForeignDrives, LOST_HEARTBEAT, NAME, PDOS
import pytest
from support import wait_until
import yaml

from facade_manipulator.drives.cia402 import DEFAULT_AXES
from facade_manipulator.drives.controller import (
    BusAccess,
    ControllerState,
    DriveController,
    MechanismChecks,
)
from facade_manipulator.drives.controller.session import Session
from facade_manipulator.resources import config_path

PATIENCE = 30.0
SETTINGS = replace(FAST, rate=20)  # Hz: all are in one process, and so is the guest's one CPU


class ForeignRig:
    """A drive controller on three drives of independent make."""

    def __init__(self, directory: Path, interface: str, channel: str) -> None:
        data = yaml.safe_load(config_path('drives/generic_cia402.yaml').read_text())
        data.update(eds=str(config_path('drives/cia402.eds')), pdos=PDOS)
        profile = directory / 'foreign.yaml'
        profile.write_text(yaml.safe_dump(data, sort_keys=False))
        axes = tuple(replace(axis, profile=str(profile)) for axis in DEFAULT_AXES)
        self.source = Source(SETTINGS.period)
        self._new_bus = lambda: can.Bus(interface=interface, channel=channel)
        self.foreign = ForeignDrives(self._new_bus, (1000, 2000, 3000))
        self.drives = self.foreign.drives
        self.other = self._new_bus()
        self.session = Session(
            SETTINGS, axes, BusAccess(self._new_bus), MechanismChecks(self.source))
        self.controller = DriveController(self.session)

    def close(self) -> None:
        with suppress(Exception):
            self.controller.close()
        self.foreign.close()
        self.other.shutdown()

    def do(self, *names: str) -> str:
        for name in names:
            answer = self.controller.request(name).result(PATIENCE)
        return answer

    @property
    def state(self) -> ControllerState:
        return self.controller.snapshot().state

    def command_network(self, command: int, node: int) -> None:
        self.other.send(can.Message(
            arbitration_id=0, data=bytes([command, node]), is_extended_id=False))


def they_are_configured_homed_and_moved(rig: ForeignRig) -> None:
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


def an_emergency_message_of_one_stops_all_and_is_cleared(rig: ForeignRig) -> None:
    rig.do('configure', 'home', 'activate')
    rig.drives[1].fail(FOLLOWING_ERROR)
    wait_until(lambda: rig.state is ControllerState.STOPPED, 'the stop')
    wait_until(lambda: ENABLED not in [drive.state for drive in rig.drives], 'all to stop')
    assert 'q2 (node 2): the following error' in rig.controller.snapshot().cause
    rig.do('clear_faults', 'activate')


def a_node_that_somebody_stops_is_brought_back(rig: ForeignRig) -> None:
    rig.do('configure', 'home')
    rig.command_network(2, 3)
    wait_until(lambda: rig.state is ControllerState.STOPPED, 'the stop')
    rig.do('clear_faults', 'activate')


def a_node_that_restarts_is_noticed_by_its_boot_up_message(rig: ForeignRig) -> None:
    rig.do('configure', 'home')
    rig.command_network(129, 1)
    wait_until(lambda: 'restarted' in rig.controller.snapshot().cause, 'the boot-up message')
    assert rig.controller.snapshot().unhomed == ('q1',)
    rig.do('cleanup', 'configure', 'home', 'activate')


def a_dead_master_is_missed_by_its_heartbeat(rig: ForeignRig) -> None:
    rig.do('configure', 'home', 'activate')
    rig.session.exchange.transmits = False
    wait_until(lambda: ENABLED not in [drive.state for drive in rig.drives], 'all to stop')
    wait_until(lambda: rig.state is ControllerState.STOPPED, 'the stop')
    assert f'{LOST_HEARTBEAT:04X}h' in str(rig.controller.snapshot().causes)


def long_objects_go_in_segments_both_ways(rig: ForeignRig) -> None:
    rig.do('configure')
    objects = rig.session.commissioning._drives[1].objects
    read = rig.session.worker.submit(objects.read, 0x1008, 0).result(PATIENCE)
    assert read == NAME
    text = bytes(range(200))
    rig.session.worker.submit(objects.write, 0x2100, 0, text).result(PATIENCE)
    assert rig.drives[1].objects.read(0x2100, 0) == text


CHECKS = {check.__name__: check for check in (
    they_are_configured_homed_and_moved, an_emergency_message_of_one_stops_all_and_is_cleared,
    a_node_that_somebody_stops_is_brought_back,
    a_node_that_restarts_is_noticed_by_its_boot_up_message,
    a_dead_master_is_missed_by_its_heartbeat, long_objects_go_in_segments_both_ways)}


def prove(check: str, directory: Path, interface: str, channel: str) -> None:
    """Make a rig for one of the checks."""
    rig = ForeignRig(directory, interface, channel)
    try:
        CHECKS[check](rig)
    finally:
        rig.close()
