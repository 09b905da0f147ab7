"""Drives as they come from the box: node ids by LSS, what they store, mechanics with faults."""

from __future__ import annotations

import struct

from canopen import lss
from drive_bench import Bench, CPM
from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.drives.cia402.states import Mode
from facade_manipulator.simulation.drives.drive import SimulatedIdentity
from facade_manipulator.simulation.drives.lss import LssSlave, UNCONFIGURED

SAVE, LOAD = int.from_bytes(b'save', 'little'), int.from_bytes(b'load', 'little')
IDENTITY = SimulatedIdentity(1, 2, 3, 0xDEADBEEF)
numbers = st.integers(0, 2**32 - 1)


def ask(bench, command, content=b''):
    """Send an LSS request; return the answers."""
    request = (bytes([command]) + content).ljust(8, b'\0')
    return [data for cob_id, data in bench.send(lss.LssMaster.LSS_TX_COBID, request)
            if cob_id == lss.LssMaster.LSS_RX_COBID]


def select_all(bench, on=True):
    assert ask(bench, lss.CS_SWITCH_STATE_GLOBAL, bytes([on])) == []


def bare_drive():
    bench = Bench(identity=IDENTITY).boot()
    select_all(bench)
    assert ask(bench, lss.CS_CONFIGURE_NODE_ID, bytes([UNCONFIGURED]))[0][1] == 0
    assert ask(bench, lss.CS_STORE_CONFIGURATION)[0][1] == 0
    select_all(bench, False)
    bench.drive.reboot()
    return bench.boot()


def scan(slave, active=UNCONFIGURED):
    """Return the identity that a fastscan finds, None if nobody answers."""
    def answers(number, bit, part, following):
        request = struct.pack('<BIBBB', lss.CS_FAST_SCAN, number, bit, part, following)
        return slave.receive(request, active) is not None

    if not answers(0, 0x80, 0, 0):
        return None
    found = []
    for part in range(4):
        number = 0
        for bit in range(31, -1, -1):
            number |= 0 if answers(number, bit, part, part) else 1 << bit
        assert answers(number, 0, part, (part + 1) % 4)
        found.append(number)
    return tuple(found)


@given(st.tuples(numbers, numbers, numbers, numbers))
def test_fastscan_finds_any_identity_and_selects_the_drive(identity):
    slave = LssSlave(UNCONFIGURED, lambda: identity)
    assert scan(slave) == identity
    assert slave.is_selected


def test_fastscan_finds_no_drive_that_has_a_node_id():
    assert scan(LssSlave(7, lambda: IDENTITY), active=7) is None


def test_a_drive_without_a_node_id_is_silent_until_it_gets_one():
    bench = bare_drive()
    assert bench.drive.node_id == UNCONFIGURED
    assert bench.send(0x602, bytes([0x40, 0, 0x10, 0, 0, 0, 0, 0])) == []
    select_all(bench)
    ask(bench, lss.CS_CONFIGURE_NODE_ID, bytes([5]))
    select_all(bench, False)
    bench.wait(0.1)
    assert (0x705, b'\0') in bench.sent
    bench.node = 5
    assert bench.read(0x1000) & 0xFFFF == 402
    assert bench.read(0x1014) == 0x85
    assert bench.read(0x1018, 4) == IDENTITY.serial_number


def test_a_node_id_that_is_none_is_rejected_and_one_that_was_not_stored_gone_after_a_power_cut():
    bench = Bench(identity=IDENTITY).boot()
    select_all(bench)
    assert [ask(bench, lss.CS_CONFIGURE_NODE_ID, bytes([node_id]))[0][1]
            for node_id in (0, 128, 254, 9)] == [1, 1, 1, 0]
    bench.nmt(130)
    bench.wait(0.1)
    assert bench.drive.node_id == 9
    bench.drive.reboot()
    bench.wait(0.1)
    assert bench.drive.node_id == bench.node


def test_only_the_selected_drive_answers():
    bench = Bench(identity=IDENTITY).boot()
    for wrong in (None, 0, 3):
        answers = [
            answer for part, number in enumerate(IDENTITY)
            for answer in ask(bench, lss.CS_SWITCH_STATE_SELECTIVE_VENDOR_ID + part,
                              struct.pack('<I', number + (part == wrong) & 0xFFFFFFFF))]
        assert bool(answers) is (wrong is None)
        assert bool(ask(bench, lss.CS_STORE_CONFIGURATION)) is (wrong is None)
        select_all(bench, False)


def test_what_is_stored_survives_a_power_cut_and_what_is_not_does_not():
    bench = Bench().boot()
    assert bench.write(0x6084, 0, 1234) is None
    assert bench.write(0x1010, 1, SAVE) is None
    assert bench.write(0x6085, 0, 4321) is None
    default = bench.drive.objects.defaults[0x6085, 0]
    bench.drive.reboot()
    bench.boot()
    assert (bench.read(0x6084), bench.read(0x6085)) == (1234, default)
    assert bench.write(0x1011, 1, LOAD) is None
    assert bench.read(0x6084) == 1234
    bench.drive.reboot()
    assert bench.boot().read(0x6084) != 1234


def test_backlash_keeps_the_carriage_behind_the_motor():
    bench = Bench(backlash=0.001).configure().enable()
    start = bench.drive.motor.carriage_position
    bench.move_at(0.02, 50)
    bench.until(lambda: abs(bench.drive.motor.velocity) < 1e-3)
    there = bench.drive.motor.carriage_position
    assert there - start == pytest.approx(0.01 - 0.0005, abs=1e-5)
    bench.move_at(-0.02, 4)
    bench.until(lambda: abs(bench.drive.motor.velocity) < 1e-3)
    assert bench.drive.motor.carriage_position == pytest.approx(there, abs=1e-9)


def test_nothing_pulls_at_the_motor_while_it_turns_in_the_play():
    bench = Bench(backlash=0.004).configure().enable()
    bench.move_at(0.02, 40)
    driving = bench.drive.motor.torque
    bench.move_at(-0.02, 10)
    assert abs(bench.drive.motor.torque) < 0.1 * driving
    bench.move_at(-0.02, 20)
    assert bench.drive.motor.torque == pytest.approx(-driving, rel=0.1)


@pytest.mark.parametrize(('opens', 'polarity', 'on'), [
    (False, 0, True), (True, 0, False), (True, 4, True)])
def test_the_home_switch_has_a_polarity_that_an_object_turns(opens, polarity, on):
    bench = Bench(home_switch_opens=opens).boot()
    bench.write(0x3141, 2, polarity)
    assert bool(bench.read(0x60FD) & 4) is on


def test_the_home_switch_bounces_at_its_edge_alone():
    bench = Bench(home_switch_bounce=0.001, start=0.005).boot()
    assert {bench.read(0x60FD) & 4 for _ in range(20)} == {0, 4}
    bench.drive.motor.place(0.0)
    assert {bench.read(0x60FD) & 4 for _ in range(20)} == {4}


def test_homing_finds_the_edge_of_a_switch_through_the_play():
    bench = Bench(backlash=0.001, start=-0.54).configure(_6098=17).enable(Mode.HOMING)
    bench.command(0x10)
    bench.until(lambda: bench.status.statusword & 0x1400 == 0x1400)
    motor = bench.drive.motor
    assert motor.carriage_position + 0.545 == pytest.approx(
        bench.status.position_counts / CPM, abs=1e-5)
