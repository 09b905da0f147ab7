"""
The fault table once more, on a bus of the kernel's: what differs there, and a row of each kind.

`test_fault_matrix` has every row in every situation, in simulated time;
``python vcan.py -- python ../fault_table.py --interface socketcan --channel vcan0`` is the whole.
"""

from __future__ import annotations

from fault_rig import OneRig
from fault_table import cases, prove_patiently, REAL, SETPOINTS
import pytest

MOVING = {
    'position lost 7380', 'TPDO missing', 'unexpected boot-up', 'following error 8611',
    'safe torque off 8A88', 'heartbeat missing', 'bus-off', *SETPOINTS}


@pytest.fixture(scope='module')
def one_rig():
    made = OneRig(interface='socketcan', channel='vcan0')
    yield made
    made.close()


@pytest.mark.parametrize(('row', 'situation'), [
    (row, situation) for row, situation in cases()
    if row in REAL or (situation == 'moving' and row in MOVING)])
def test_the_fault_table_holds_on_a_real_bus(one_rig, vcan0, row, situation):
    prove_patiently(one_rig, row, situation)
