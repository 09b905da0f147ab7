from facade_manipulator.canopen import indices
from facade_manipulator.canopen.lss import LssSlave, UNCONFIGURED

IDENTITY = (0xFB, 0x62100000, 1, 4711)
PARTS = enumerate(IDENTITY, start=1)
VALUES = {(indices.IDENTITY, part): one for part, one in PARTS}


def slave() -> LssSlave:
    return LssSlave(UNCONFIGURED, VALUES)


def ask(node: LssSlave, request: str) -> bytes | None:
    """Return the first byte of the answer to a request in hexadecimal digits."""
    answer = node.receive(bytes.fromhex(request).ljust(8, b'\0'), node.pending)
    return None if answer is None else answer[:1]


def test_four_numbers_in_order_select_a_slave():
    node = slave()
    requests = ['40fb000000', '4100001062', '4201000000', '4367120000']
    assert [ask(node, one) for one in requests] == [None, None, None, b'\x44']
    assert node.is_selected


def test_wrong_number_begins_the_selection_again():
    node = slave()
    for request in ('40fb000000', '4100001063', '4201000000', '4367120000'):
        assert ask(node, request) is None
    assert not node.is_selected


def test_selected_slave_takes_and_stores_a_node_id():
    node = slave()
    ask(node, '0401')
    assert ask(node, '1105') == b'\x11'
    assert node.pending == 5
    assert node.stored == UNCONFIGURED
    assert ask(node, '17') == b'\x17'
    assert node.stored == 5


def test_slave_answers_fastscan_only_for_matching_bits():
    node = slave()
    assert ask(node, '5100000000800000') == b'\x4f'  # any slave without a node id
    assert ask(node, '51000000001f0000') == b'\x4f'  # bit 31 of the vendor is 0
    assert ask(node, '51000000801f0000') is None
