"""Process data of the default map as bytes, built and read for tests of a bus."""

from collections import namedtuple
from collections.abc import Callable

from facade_manipulator.canopen.pdo import Pdo, RPDO1, TPDO1, TPDO2, TPDO3


def _decoder(pdo: Pdo, names: str) -> Callable:
    frame = namedtuple('Frame', names)
    return lambda data: frame._make(pdo.codec.unpack(data))


encode_rpdo1 = RPDO1.codec.pack
encode_tpdo1 = TPDO1.codec.pack
decode_rpdo1 = _decoder(RPDO1, 'controlword mode target_counts')
decode_tpdo1 = _decoder(TPDO1, 'statusword mode position_counts')
# in the drive's velocity unit
decode_tpdo2 = _decoder(TPDO2, 'velocity following_error_counts')
# in thousandths of the rated
decode_tpdo3 = _decoder(TPDO3, 'error_code torque digital_inputs')
