from frames import decode_tpdo1, decode_tpdo2, decode_tpdo3, encode_rpdo1
import pytest

from facade_manipulator.canopen import pdo


def test_process_data_is_little_endian_and_packed():
    assert encode_rpdo1(0x000F, 8, -2) == bytes.fromhex('0f0008feffffff')
    assert decode_tpdo1(bytes.fromhex('371208785634f2')) == (0x1237, 8, -0x0DCBA988)
    assert decode_tpdo2(bytes.fromhex('01000000ffffffff')) == (1, -1)
    assert decode_tpdo3(bytes.fromhex('1186ffff04000000')) == (0x8611, -1, 4)


def test_cob_ids_match_the_predefined_connection_set():
    assert [p.cob_id(2) for p in pdo.PDO_MAP] == [0x202, 0x182, 0x282, 0x382]
    unused = [p.cob_id(2) for p in pdo.unused_pdos(pdo.PDO_MAP)]
    assert unused == [0x302, 0x402, 0x502, 0x482]


# masks of the bits read back; bits 30 and 28 to 11 of a COB-ID are reserved
ALL = 0xFFFFFFFF
COB_ID = 0xA00007FF
TWO_CHANGES = 0


TPDO1_WRITES = [
    (0x1800, 1, 0xC0000181, 4, True, TWO_CHANGES),
    (0x1A00, 0, 0, 1, True, TWO_CHANGES),
    (0x1A00, 1, 0x60410010, 4, True, ALL),
    (0x1A00, 2, 0x60610008, 4, True, ALL),
    (0x1A00, 3, 0x60640020, 4, True, ALL),
    (0x1A00, 0, 3, 1, True, ALL),
    (0x1800, 2, 1, 1, True, ALL),
    (0x1800, 1, 0x40000181, 4, True, COB_ID),
]


def test_configuration_of_pdo1_matches_the_transcripts():
    tpdo = pdo.TPDO1.configure_writes(1, rate=100)
    assert [tuple(write) for write in tpdo] == TPDO1_WRITES
    rpdo = pdo.RPDO1.configure_writes(2, rate=100)
    assert rpdo[0][:3] == (0x1400, 1, 0x80000202)
    assert rpdo[-2][:3] == (0x1400, 2, 1)
    assert rpdo[-1][:3] == (0x1400, 1, 0x202)


@pytest.mark.parametrize(
    ('name', 'indices', 'syncs'),
    [
        ('RPDO2', [0x6040], 1),
        ('TPDO4', [0x6077, 0x6064], 1),
        ('TPDO2', [0x60F4], 1),
        ('TPDO3', [0x6077, 0x60FD], 10),
    ],
)
def test_tpdo_with_only_conditions_is_sent_less_often(name, indices, syncs):
    objects = tuple(pdo.KNOWN_OBJECTS[index] for index in indices)
    assert pdo.Pdo(name, objects).transmission(100) == syncs
