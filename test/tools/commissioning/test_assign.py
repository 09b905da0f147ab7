"""Command `assign`: our slaves with habits of others, and slaves of durand's stack."""

from __future__ import annotations

import os
import time

import can
from canopen import lss
from commission_rig import SERIALS
import pytest

from facade_manipulator.simulation.drives.lss import LssSlave, UNCONFIGURED
from facade_manipulator.tools.commissioning.__main__ import main
from facade_manipulator.tools.commissioning.machine import Machine

durand = pytest.importorskip(
    'durand', reason='the CANopen stack of the foreign slaves is not installed')

FAST = ('--lss-timeout', '0.15')
ASSIGN = ('assign', *FAST, '--serials', *map(str, SERIALS))
DRIVE, IO_MODULE = 0x20192, 0x191
VENDOR, PRODUCT, REVISION = 0xFB, 0x1001, 7


class Slave(durand.MinimalNode):
    """A slave that stores its id slowly, knows fastscan alone and takes an id when it is reset."""

    def __init__(self, bus: can.BusABC, serial: int, node_id: int, kind: int = DRIVE) -> None:
        self.bus, self.stored, self.keeps = bus, node_id, True
        super().__init__(durand.CANBusNetwork(bus), node_id)
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
            self.lss.on_nmt_state_update(durand.services.nmt.StateEnum.INITIALISATION)
        elif data[0] != 0x4C:
            self.lss.handle_msg(cob_id, data)


@pytest.fixture
def slaves(tmp_path):
    """Return what makes slaves of serial numbers and kinds, all with one node id."""
    made = []

    def make(node_id: int, **kinds: int) -> list[Slave]:
        made.extend(Slave(
            can.Bus(interface='virtual', channel='assign', ignore_config=True), int(name[1:]),
            node_id, kind) for name, kind in kinds.items())
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


HUNDREDS = ('--lss-timeout', '0.05', '--serials', '300', '100', '200')


@pytest.mark.parametrize('node_id', [1, 255])
def test_the_ids_are_those_of_the_carriages_and_a_stranger_gets_none(
        slaves, commission, tmp_path, node_id):
    made = slaves(node_id, s50=DRIVE, s60=IO_MODULE, s100=DRIVE, s200=DRIVE, s300=DRIVE)
    assert commission('assign', *HUNDREDS) == 0
    assert [slave.stored for slave in made] == [node_id, node_id, 2, 3, 1]
    assert len({slave.node_id for slave in made}) == 5
    axes = Machine(tmp_path / 'machine.yaml').axes
    assert [axis.serial_number for axis in axes.values()] == [300, 100, 200]


def test_a_drive_that_says_stored_but_is_not_is_named_with_its_state(slaves, commission, capsys):
    made = slaves(1, s100=DRIVE, s200=DRIVE, s300=DRIVE)
    made[1].keeps = False
    assert commission('assign', *HUNDREDS) == 1
    said = capsys.readouterr().err
    assert 'no drive answers as node 3 instead of 200 after a reset' in said
    assert 'q2 is node 2 (serial number 100); the others have their old ones again' in said


# --- simulated drives

@pytest.mark.parametrize('frame', [
    (0x77F, b'\x05'), (0x80, b''), (0x000, b'\x80\x09'), (0x202, bytes(7)), (0x602, bytes(8))])
def test_no_command_works_beside_a_driver(make_rig, capsys, frame):
    rig = make_rig('--new')
    with can.Bus(interface='virtual', channel=rig.channel, ignore_config=True) as driver:
        task = driver.send_periodic(
            can.Message(arbitration_id=frame[0], data=frame[1], is_extended_id=False), 0.05)
        assert rig.run(*ASSIGN) == 1
        task.stop()
    assert 'a driver runs on this bus' in capsys.readouterr().err
    assert not rig.parameters.exists()
    assert {drive.lss.stored for drive in rig.drives} == {1}


class Lely(LssSlave):
    """A slave of lely-core: answers fastscan with a node id, too (src/co/lss.c of 620d1858)."""

    def receive(self, data: bytes, active: int) -> bytes | None:
        is_scan = data[0] == lss.CS_FAST_SCAN
        return super().receive(data, UNCONFIGURED if is_scan else active)


class CanopenNode(LssSlave):
    """A slave of CANopenNode: no 4Ch, yes to any fastscan once selected (305/CO_LSSslave.c)."""

    def receive(self, data: bytes, active: int) -> bytes | None:
        if data[0] == lss.CS_IDENTIFY_NON_CONFIGURED_REMOTE_SLAVE:
            return None
        if data[0] == lss.CS_FAST_SCAN and self.is_selected:
            return bytes([lss.CS_IDENTIFY_SLAVE]).ljust(8, b'\0')
        return super().receive(data, active)


@pytest.mark.parametrize('makes', [
    [LssSlave] * 3, [Lely] * 3, [CanopenNode] * 3, [Lely, CanopenNode, LssSlave]])
@pytest.mark.parametrize('new', ['1', '255'])
def test_new_drives_of_any_make_get_the_node_ids_of_their_carriages(make_rig, capsys, new, makes):
    rig = make_rig('--new', new)
    for drive, make in zip(rig.drives, makes, strict=True):
        drive.lss.__class__ = make
    shuffled = (SERIALS[2], SERIALS[0], SERIALS[1])
    assert rig.run('assign', *FAST, '--serials', *map(str, shuffled)) == 0, capsys.readouterr().err
    assert not any(drive.lss.is_selected for drive in rig.drives)
    rig.power_cut()
    assert [drive.node_id for drive in rig.drives] == [2, 3, 1]
    axes = Machine(rig.parameters).axes
    assert [(axis.node_id, axis.serial_number) for axis in axes.values()] == list(
        zip((1, 2, 3), shuffled, strict=True))
    assert '# CANopen; every new drive is 1' in rig.parameters.read_text()
    assert rig.run('scan') == 0


@pytest.mark.parametrize('new', ['1', '255'])
def test_one_drive_alone_needs_neither_fastscan_nor_selection(make_rig, new):
    rig = make_rig('--new', new, '--node-ids', '1', '--serial-numbers', '99',
                   '--start-positions', '0')
    slave, asked = rig.drives[0].lss, []
    receive = slave.receive
    slave.receive = lambda data, active: asked.append(data[0]) or receive(data, active)
    assert rig.run('assign', *FAST, '--only', 'q3') == 0
    assert slave.stored == 3 and set(asked) <= {0x04, 0x11, 0x17}
    assert Machine(rig.parameters).axis('q3').serial_number == 99


def test_only_wants_one_drive_alone(make_rig, rejected):
    rig = make_rig('--new')
    assert 'found 3' in rejected(rig.run, 'assign', *FAST, '--only', 'q3')
    assert {drive.lss.stored for drive in rig.drives} == {1}


def test_drives_without_lss_are_left_to_the_makers_tool(make_rig, rejected):
    rig = make_rig('--new')
    for drive in rig.drives:
        drive.lss.receive = lambda data, active: None
    assert "in the maker's tool" in rejected(rig.run, *ASSIGN)


def test_a_drive_that_stops_answering_in_the_middle_is_one_message(make_rig, capsys):
    rig = make_rig('--new')
    last = rig.drives[2]
    receive = last.lss.receive
    last.lss.receive = lambda data, active: None if data[0] == 0x17 else receive(data, active)
    assert rig.run(*ASSIGN) == 1
    said = capsys.readouterr().err
    assert 'did not store it' in said and 'serial number 4711' in said
    assert last.lss.stored == 1


def test_a_serial_number_that_is_not_there_names_the_axis(make_rig, capsys):
    rig = make_rig('--new')
    assert rig.run('assign', *FAST, '--serials', '4711', '4712', '1') == 1
    assert 'no drive was found for q3' in capsys.readouterr().err


@pytest.mark.parametrize('text', ['[', 'just words', '/**/driver: {ros__parameters: 3}',
                                  '/**/driver: {ros__parameters: {q1: {node_id: 900}}}',
                                  '/**/driver: {ros__parameters: {q1: {nodeid: 1}}}'])
def test_a_parameter_file_that_is_none_stops_before_anything_is_done(make_rig, rejected, text):
    rig = make_rig('--new')
    rig.parameters.write_text(text)
    assert str(rig.parameters) in rejected(rig.run, *ASSIGN)
    assert rig.parameters.read_text() == text
    assert {drive.lss.stored for drive in rig.drives} == {1}


@pytest.mark.skipif(os.geteuid() == 0, reason='root may write everywhere')
def test_a_protected_folder_stops_before_anything_is_done(make_rig, capsys):
    rig = make_rig('--new')
    rig.folder.chmod(0o500)
    try:
        assert rig.run(*ASSIGN) == 1
    finally:
        rig.folder.chmod(0o700)
    assert 'cannot be written' in capsys.readouterr().err


def test_a_file_that_cannot_be_written_in_the_end_leaves_the_lines_to_write(
        make_rig, rejected, monkeypatch):
    rig = make_rig('--new')
    rig.parameters.mkdir()
    assert str(rig.parameters) in rejected(rig.run, *ASSIGN)


@pytest.mark.parametrize('at', [0, 1, 2, 3])
def test_ctrl_c_at_any_prompt_of_assign_leaves_the_stored_ids_and_says_so(
        make_rig, capsys, monkeypatch, at):
    rig, asked = make_rig('--new'), []

    def answer(*_):
        asked.append('')
        if len(asked) > at:
            raise KeyboardInterrupt
        return ('y', 'q1', 'q2')[len(asked) - 1]

    monkeypatch.setattr('builtins.input', answer)
    assert rig.run('assign', *FAST, yes=False) == 1
    assert ('nothing is changed', 'stopped by Ctrl-C. No drive has stored a new',
            'Ctrl-C. q1 is node 1 (serial', 'q2 is node 2 (serial')[at] in capsys.readouterr().err
    assert sorted(drive.lss.stored for drive in rig.drives) == [[1, 1, 1], [1, 1, 1], [1, 1, 1],
                                                                [1, 1, 2]][at]
    assert not rig.parameters.exists()
