from facade_manipulator.canopen import nmt
from facade_manipulator.canopen.nmt import SupervisedHeartbeat


def test_commands_and_heartbeats_match_the_transcripts():
    assert nmt.command('OPERATIONAL', 2) == bytes.fromhex('0102')
    assert nmt.command('RESET COMMUNICATION', 0) == bytes.fromhex('8200')
    assert nmt.heartbeat('OPERATIONAL') == bytes.fromhex('05')


def test_state_of_heartbeat_ignores_the_reserved_bit():
    assert nmt.state_number(b'\x85') == nmt.state_number(b'\x05') == 5


def test_supervised_heartbeat_ignores_the_reserved_byte():
    supervised = SupervisedHeartbeat(127, 150)
    assert supervised.encode() == 0x007F0096
    assert SupervisedHeartbeat.decode(0xFF7F0096) == supervised
