import pytest

from facade_manipulator.canopen import nmt, sync
from facade_manipulator.canopen.nmt import SupervisedHeartbeat


def test_commands_and_heartbeats_match_the_transcripts():
    assert nmt.command('OPERATIONAL', 2) == bytes.fromhex('0102')
    assert nmt.command('RESET COMMUNICATION', 0) == bytes.fromhex('8200')
    assert nmt.heartbeat('OPERATIONAL') == bytes.fromhex('05')


@pytest.mark.parametrize(
    ('name', 'specifier'),
    [
        ('OPERATIONAL', 1),
        ('STOPPED', 2),
        ('PRE-OPERATIONAL', 128),
        ('RESET', 129),
        ('RESET COMMUNICATION', 130),
    ],
)
def test_nmt_command_has_its_specifier_of_cia_301(name, specifier):
    assert nmt.command(name, 3) == bytes([specifier, 3])


@pytest.mark.parametrize(
    ('name', 'number'),
    [('INITIALISING', 0), ('STOPPED', 4), ('OPERATIONAL', 5), ('PRE-OPERATIONAL', 127)],
)
def test_heartbeat_has_the_state_number_of_cia_301(name, number):
    assert nmt.heartbeat(name) == bytes([number])


def test_node_that_waits_for_its_start_sets_bit_2():
    """CiA 302-2: bit 2 of 1F80h."""
    assert nmt.WAITS_FOR_START == 1 << 2


def test_producer_of_sync_sets_bit_30():
    """CiA 301: bit 30 of 1005h."""
    assert sync.PRODUCER == 1 << 30


def test_state_of_heartbeat_ignores_the_reserved_bit():
    assert nmt.state_number(b'\x85') == nmt.state_number(b'\x05') == 5


def test_supervised_heartbeat_ignores_the_reserved_byte():
    supervised = SupervisedHeartbeat(127, 150)
    assert supervised.encode() == 0x007F0096
    assert SupervisedHeartbeat.decode(0xFF7F0096) == supervised
