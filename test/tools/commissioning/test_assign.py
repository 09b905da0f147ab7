"""Command `assign` on slaves of independent make: the stack is durand's, with habits of others."""

from __future__ import annotations

import time

import can
import pytest

pytest.importorskip('durand', reason='the CANopen stack of the foreign slaves is not installed')
from durand import CANBusNetwork, MinimalNode  # noqa: E402
from durand.services.nmt import StateEnum  # noqa: E402

from facade_manipulator.tools.commissioning.__main__ import main  # noqa: E402
from facade_manipulator.tools.commissioning.machine import Machine  # noqa: E402

DRIVE, IO_MODULE = 0x20192, 0x191
VENDOR, PRODUCT, REVISION = 0xFB, 0x1001, 7


class Slave(MinimalNode):
    """A slave that stores its id slowly, knows fastscan alone and takes an id when it is reset."""

    def __init__(self, bus: can.BusABC, serial: int, node_id: int, kind: int = DRIVE) -> None:
        self.bus, self.stored, self.keeps = bus, node_id, True
        super().__init__(CANBusNetwork(bus), node_id)
        for index, subindex, value in ((0x1000, 0, kind), (0x1018, 1, VENDOR), (
                0x1018, 2, PRODUCT), (0x1018, 3, REVISION), (0x1018, 4, serial)):
            self.object_dictionary.write(index, subindex, value)
        self.lss.set_store_configuration_callback(self._store)
        self.network.add_subscription(0, self._on_nmt)
        self.network.add_subscription(0x7E5, self._on_lss)

    def _store(self, _: object, node_id: int) -> None:
        time.sleep(2.0)
        self.stored = node_id if self.keeps else self.stored

    def _on_nmt(self, cob_id: int, data: bytes) -> None:
        if data[0] == 0x81 and data[1] in (0, self.node_id):
            self.nmt.pending_node_id = self.stored
        self.nmt.handle_msg(cob_id, data)

    def _on_lss(self, cob_id: int, data: bytes) -> None:
        if data[:2] == b'\x04\x00':  # the id is taken when it is reset, and not before
            self.lss.on_nmt_state_update(StateEnum.INITIALISATION)
        elif data[0] != 0x4C:
            self.lss.handle_msg(cob_id, data)


@pytest.fixture
def slaves(simulated_time, tmp_path):
    """Return what makes slaves of serial numbers and kinds, all with one node id."""
    made = []

    def make(node_id: int, **kinds: int) -> list[Slave]:
        made.extend(Slave(can.Bus(interface='virtual', channel='assign'), int(name[1:]), node_id,
                          kind) for name, kind in kinds.items())
        return made

    yield make
    for slave in made:
        slave.network.stop()
        slave.bus.shutdown()


@pytest.fixture
def commission(tmp_path):
    """Run a command on the slaves' bus, with the serial numbers of q1, q2 and q3."""
    return lambda command, *options: main([
        command, '--interface', 'virtual', '--channel', 'assign', '--yes',
        '--parameters', str(tmp_path / 'machine.yaml'), *options])


SERIALS = ('--lss-timeout', '0.05', '--serials', '300', '100', '200')


@pytest.mark.parametrize('node_id', [1, 255])
def test_the_ids_are_those_of_the_carriages_and_a_stranger_gets_none(
        slaves, commission, tmp_path, node_id):
    made = slaves(node_id, s50=DRIVE, s60=IO_MODULE, s100=DRIVE, s200=DRIVE, s300=DRIVE)
    assert commission('assign', *SERIALS) == 0
    assert [slave.stored for slave in made] == [node_id, node_id, 2, 3, 1]
    assert len({slave.node_id for slave in made}) == 5
    axes = Machine(tmp_path / 'machine.yaml').axes
    assert [axis.serial_number for axis in axes.values()] == [300, 100, 200]


def test_nobody_is_asked_which_carriage_an_io_module_moves(
        slaves, commission, monkeypatch, capsys):
    slaves(1, s60=IO_MODULE)
    monkeypatch.setattr('builtins.input', pytest.fail)
    assert commission('assign', *SERIALS) == 1
    assert 'no drive was found for q1, q2, q3' in capsys.readouterr().err


def test_a_drive_that_says_stored_but_is_not_is_named_with_its_state(slaves, commission, capsys):
    made = slaves(1, s100=DRIVE, s200=DRIVE, s300=DRIVE)
    made[1].keeps = False
    assert commission('assign', *SERIALS) == 1
    said = capsys.readouterr().err
    assert 'no drive answers as node 3 instead of 200 after a reset' in said
    assert 'q2 is node 2 (serial number 100); the others have their old ones again' in said


def test_a_scan_sees_nodes_without_an_id_that_know_fastscan_alone(slaves, commission, capsys):
    slaves(255, s100=DRIVE)
    assert commission('scan') == 1
    assert 'there is a drive without a node id: commission assign' in capsys.readouterr().out
