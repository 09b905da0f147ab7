"""Commands `scan` and `assign`, with simulated slaves and slaves of other stacks."""

import itertools

from canopen import lss
import durand
from fake_bus import FakeBus
import pytest
from tools.commissioning.rig import raising, SERIALS

from facade_manipulator.canopen.lss import lss_master, LssSlave, UNCONFIGURED
from facade_manipulator.tools.commissioning.tool_bus import ToolBus

pytestmark = pytest.mark.long

ASSIGN = ('assign', '--serials', '4713', '4711', '4712')
DRIVE = 0x20192
IO_MODULE = 0x191


def test_scan_lists_drives_and_profiles(rig, capsys):
    assert rig.run('scan') == 0
    lines = capsys.readouterr().out.splitlines()
    words = [line.split() for line in lines[1:4]]
    assert words == [
        ['1', '1', '0', '0', 'simulated'],
        ['2', '2', '0', '0', 'simulated'],
        ['3', '3', '0', '0', 'simulated'],
    ]


@pytest.mark.parametrize(
    ('new', 'is_silent', 'message'),
    [
        (
            '1',
            False,
            '3 drives have node id 1 (serial numbers 4711, 4712, 4713); next: commission',
        ),
        ('255', False, 'a drive has no node id; next: commission assign'),
        ('1', True, 'q1 (node 1) does not answer; next: check power, plug'),
    ],
)
def test_scan_names_each_problem(make_rig, rejected, new, is_silent, message):
    for drive in make_rig('--new', new).drives:
        drive.is_silent = is_silent
    assert message in rejected('scan')


class Lely(LssSlave):
    """Slave of lely-core, which answers fastscan even with a node id (lss.c of 620d1858)."""

    def receive(self, data: bytes, active: int) -> bytes | None:
        is_scan = data[0] == lss.CS_FAST_SCAN
        return super().receive(data, UNCONFIGURED if is_scan else active)


class CanopenNode(LssSlave):
    """Slave of CANopenNode, which answers any fastscan once selected (305/CO_LSSslave.c)."""

    def receive(self, data: bytes, active: int) -> bytes | None:
        if data[0] == lss.CS_FAST_SCAN and self.is_selected:
            return bytes([lss.CS_IDENTIFY_SLAVE]).ljust(8, b'\0')
        return super().receive(data, active)


@pytest.mark.parametrize(
    'makes',
    [[LssSlave] * 3, [Lely] * 3, [CanopenNode] * 3, [Lely, CanopenNode, LssSlave]],
)
@pytest.mark.parametrize('new', ['1', '255'])
def test_new_drives_get_the_node_ids_of_their_carriages(make_rig, new, makes):
    rig = make_rig('--new', new)
    for drive, make in zip(rig.drives, makes, strict=True):
        drive.lss.__class__ = make
    assert rig.run(*ASSIGN) == 0
    assert not any(drive.lss.is_selected for drive in rig.drives)
    rig.power_cut()
    assert [drive.node_id for drive in rig.drives] == [2, 3, 1]
    serials = [rig.parameters[f'q{node}.serial_number'] for node in (1, 2, 3)]
    assert serials == [4713, 4711, 4712]


def delay_lss(rig, latencies) -> None:
    """Let each drive answer LSS requests after its latency [s]."""
    for drive, latency in zip(rig.drives, latencies, strict=True):

        def receive(data, active, lss=drive.lss, latency=latency):
            answer = type(lss).receive(lss, data, active)
            if answer is not None:
                rig.later(latency, lambda: rig.deliver([(0x7E4, answer)]))

        drive.lss.receive = receive


@pytest.mark.parametrize(
    'latencies',
    [
        (0.03, 0.03, 0.03),
        (0.001, 0.03, 0.06),
        (0.0, 0.09, 0.04),
        (0.15, 0.15, 0.15),
        (0.001, 0.12, 0.03),
    ],
)
def test_new_drives_that_answer_late_get_their_node_ids(make_rig, latencies):
    rig = make_rig('--new')
    delay_lss(rig, latencies)
    assert rig.run(*ASSIGN) == 0
    rig.power_cut()
    assert [drive.node_id for drive in rig.drives] == [2, 3, 1]


def test_fastscan_of_fast_slaves_takes_seconds(make_rig):
    rig = make_rig('--new', '255')
    master = lss_master(ToolBus(rig.open_bus(), rig.clock), 0.1)
    begin = rig.clock.now
    is_found, _ = master.fast_scan()
    assert is_found
    assert rig.clock.now - begin < 10.0


def test_interrupted_tool_reads_the_answers_that_wait(make_rig):
    rig = make_rig('--new')
    delay_lss(rig, (0.03, 0.03, 0.03))
    count = itertools.count()

    class InterruptedBus(FakeBus):
        def receive(self, timeout):
            frame = super().receive(timeout)
            if frame is None and timeout > 0.01 and next(count) % 7 == 0:
                rig.pass_time(0.15)
            return frame

    rig.make_bus = InterruptedBus
    assert rig.run(*ASSIGN) == 0


def test_silent_drive_times_out_on_a_busy_bus(make_rig):
    rig = make_rig()
    bus = ToolBus(rig.open_bus(), rig.clock)

    def send() -> None:
        rig.deliver([(0x182, bytes(8))])
        rig.later(0.001, send)

    send()
    rig.drives[0].is_silent = True
    begin = rig.clock.now
    assert bus.number(rig.drives[0].node_id, 0x1000) is None
    assert rig.clock.now - begin < 1.0
    assert bus.number(rig.drives[1].node_id, 0x1000) is not None


class Wire(durand.network.NetworkABC):
    """Network of a slave of the canopen library, in the simulated time of the rig."""

    def __init__(self) -> None:
        self.callbacks = {}
        self.sent = []

    def add_subscription(self, cob_id: int, callback) -> None:
        self.callbacks[cob_id] = callback

    def remove_subscription(self, cob_id: int) -> None:
        del self.callbacks[cob_id]

    def send(self, cob_id: int, msg: bytes) -> None:
        self.sent.append((cob_id, bytes(msg)))

    def receive(self, cob_id: int, data: bytes) -> list[tuple[int, bytes]]:
        if cob_id in self.callbacks:
            self.callbacks[cob_id](cob_id, data)
        sent = self.sent
        self.sent = []
        return sent


class ForeignSlave(durand.MinimalNode):
    """Slave that supports only fastscan, and uses a new node id only after a reset."""

    def __init__(self, serial: int, kind: int, keeps: bool = True) -> None:
        self.stored = 1
        self.keeps = keeps
        super().__init__(Wire(), self.stored)
        for index, subindex, value in (
            (0x1000, 0, kind),
            (0x1018, 1, 0xFB),
            (0x1018, 4, serial),
        ):
            self.object_dictionary.write(index, subindex, value)
        self.lss.set_store_configuration_callback(self._store)
        self.network.add_subscription(0, self._on_nmt)
        self.network.add_subscription(0x7E5, self._on_lss)

    def _store(self, _: object, node_id: int) -> None:
        self.stored = node_id if self.keeps else self.stored

    def _on_nmt(self, cob_id: int, data: bytes) -> None:
        if data[0] == 0x81 and data[1] in (0, self.node_id):
            self.nmt.pending_node_id = self.stored
        self.nmt.handle_msg(cob_id, data)

    def _on_lss(self, cob_id: int, data: bytes) -> None:
        if data[:2] == b'\x04\x00':  # the id is used after a reset, not before
            self.lss.on_nmt_state_update(durand.services.nmt.StateEnum.INITIALISATION)
        else:
            self.lss.handle_msg(cob_id, data)


def add_foreign(rig, *slaves: ForeignSlave) -> None:
    rig.drives.clear()
    rig.nodes = [slave.network.receive for slave in slaves]


def test_assign_sets_foreign_drives_and_skips_io_modules(make_rig):
    rig = make_rig('--new')
    drives = [ForeignSlave(one, DRIVE) for one in SERIALS]
    slaves = [ForeignSlave(50, DRIVE), ForeignSlave(60, IO_MODULE), *drives]
    add_foreign(rig, *slaves)
    assert rig.run(*ASSIGN) == 0
    assert [slave.stored for slave in slaves] == [1, 1, 2, 3, 1]
    assert len({slave.node_id for slave in slaves}) == 5
    assert rig.parameters['axes.profile'] == 'epos4'


def test_foreign_slave_not_storing_its_node_id_is_named(make_rig, rejected):
    rig = make_rig('--new')
    slaves = [ForeignSlave(one, DRIVE, keeps=one != SERIALS[1]) for one in SERIALS]
    add_foreign(rig, *slaves)
    said = rejected(*ASSIGN)
    assert 'node 3 sent no boot-up message in 5 s' in said
    assert 'q2 has stored node id 2 (serial number 4711)' in said
    assert 'q3 has' not in said


# --- what ends an assignment


@pytest.mark.parametrize(
    'frame',
    [
        (0x77F, b'\x05'),
        (0x80, b''),
        (0x000, b'\x80\x09'),
        (0x202, bytes(7)),
        (0x602, bytes(8)),
    ],
)
def test_commands_are_rejected_while_another_master_is_active(
    make_rig, rejected, frame
):
    rig = make_rig('--new')
    rig.later(0.3, lambda: rig.deliver([frame]))
    assert 'is in use by another master' in rejected(*ASSIGN)
    assert {drive.lss.stored for drive in rig.drives} == {1}


def test_drive_that_sends_sync_is_a_possible_sender(make_rig, rejected):
    rig = make_rig()
    stored = rig.drives[1].objects.stored
    stored[0x1005, 0] = 0x40000080
    stored[0x1006, 0] = 50_000
    rig.power_cut()
    assert 'a drive sends SYNC itself: clear bit 30 of its 1005h' in rejected('scan')


def test_drives_without_lss_need_the_tool_of_their_maker(make_rig, rejected):
    rig = make_rig('--new')
    for drive in rig.drives:
        drive.lss.receive = lambda data, active: None
    assert 'in the tool of their maker' in rejected(*ASSIGN)


@pytest.mark.parametrize(
    ('serials', 'missing', 'spare'),
    [
        ('4711 4712 4731', 'q3: 4731', '4713'),
        ('1 4712 2', 'q1: 1, q3: 2', '4711, 4713'),
        ('1 2 3', 'q1: 1, q2: 2, q3: 3', '4711, 4712, 4713'),
    ],
)
def test_mistyped_serial_number_is_named_with_drives_found(
    make_rig, rejected, serials, missing, spare
):
    make_rig('--new')
    reason = rejected('assign', '--serials', *serials.split())
    assert (
        f'--serials rejected: no drive has these serial numbers ({missing})' in reason
    )
    assert f'found for no carriage: {spare}; next: correct --serials' in reason
    assert 'plug' not in reason


@pytest.mark.parametrize(
    ('answers', 'missing', 'spare'),
    [
        (('', '', ''), 'q1, q2, q3', '4711, 4712, 4713'),
        (('q1', '', 'q3'), 'q2', '4712'),
    ],
)
def test_answer_nothing_leaves_a_carriage_without_drive(
    make_rig, rejected, answers, missing, spare
):
    rig = make_rig('--new')
    rig.answers = dict(zip(map(str, SERIALS), answers, strict=True))
    reason = rejected('assign', yes=False)
    assert f'{missing} rejected: drives found for no carriage: {spare}' in reason
    assert 'next: repeat commission assign, and answer with the carriages' in reason
    assert 'plug' not in reason


def test_missing_drive_is_searched_with_fewer_spare_drives(make_rig, rejected):
    rig = make_rig('--new')
    rig.drives[2].is_silent = True
    reason = rejected('assign', '--serials', '4711', '1', '4713')
    assert '(q2: 1, q3: 4713)' in reason
    assert (
        'found for no carriage: 4712; next: correct --serials, and check the' in reason
    )


def test_drive_that_is_not_found_names_its_axis(make_rig, rejected):
    rig = make_rig('--new')
    rig.drives[2].is_silent = True
    reason = rejected('assign', '--serials', *map(str, SERIALS))
    assert 'no drive was found with fastscan for q3; next: check its plug' in reason


def test_equal_serial_numbers_are_rejected_before_the_first_frame(make_rig, rejected):
    rig = make_rig('--new')
    assert '--serials 4711 4711 4712 rejected' in rejected(
        'assign', '--serials', '4711', '4711', '4712'
    )
    assert {drive.lss.pending for drive in rig.drives} == {1}


@pytest.mark.parametrize(
    ('at', 'message', 'stored'),
    [
        ('Do this', 'interrupted', [1, 1, 1]),
        ('4711', 'interrupted\nDrives without a stored node id', [1, 1, 1]),
        ('4712', 'q2 has stored node id 2 (serial number 4711)', [2, 1, 1]),
    ],
)
def test_interrupted_assign_states_the_stored_node_ids(
    make_rig, rejected, at, message, stored
):
    rig = make_rig('--new')
    rig.answers = {
        '4711': 'q2',
        '4712': 'q3',
        '4713': 'q1',
        at: raising(KeyboardInterrupt),
    }
    said = rejected('assign', yes=False)
    assert message in said
    assert 'Written into machine.yaml: nothing' in said
    assert [drive.lss.stored for drive in rig.drives] == stored
