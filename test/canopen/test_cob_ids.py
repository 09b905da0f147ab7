import pytest

from facade_manipulator.canopen import cob_ids


@pytest.mark.parametrize(
    ('name', 'value'),
    [  # CiA 301: predefined connection set; CiA 305
        ('NMT', 0x000),
        ('SYNC', 0x080),
        ('EMERGENCY', 0x080),
        ('TPDO', 0x180),
        ('RPDO', 0x200),
        ('PDO_STEP', 0x100),
        ('SDO_RESPONSE', 0x580),
        ('SDO_REQUEST', 0x600),
        ('HEARTBEAT', 0x700),
        ('LSS_RESPONSE', 0x7E4),
        ('LSS_REQUEST', 0x7E5),
    ],
)
def test_cob_id_is_that_of_the_standard(name, value):
    assert getattr(cob_ids, name) == value


@pytest.mark.parametrize(
    ('mask', 'bits'),
    [
        (cob_ids.NOT_VALID, [31]),
        (cob_ids.RTR_NOT_ALLOWED, [30]),
        (cob_ids.EXTENDED_FRAME, [29]),
        (cob_ids.COB_ID_BITS, range(11)),
    ],
)
def test_mask_of_a_cob_id_object_has_its_bits(mask, bits):
    assert mask == sum(1 << bit for bit in bits)
