"""Drives as they come from the box: node ids by LSS, what they store, mechanics with faults."""

from __future__ import annotations

import struct

from canopen import lss
from drive_bench import Bench
from hypothesis import given
from hypothesis import strategies as st
import pytest

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


def test_drive_without_node_id_is_silent_until_assigned():
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


