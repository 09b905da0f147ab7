"""
The fault table once more, on a bus of the kernel's: what differs there.

`test_fault_matrix` has every row in every situation, in simulated time;
``python vcan.py -- python ../fault_table.py --interface socketcan --channel vcan0`` is the whole.
"""

from __future__ import annotations

from dataclasses import replace

from fault_rig import OneRig, PATIENT
from fault_table import prove_patiently, REAL
import pytest

ROWS = [(row, situation) for row in REAL for situation in ('inactive', 'moving')]


@pytest.fixture(scope='module')
def one_rig():
    # four threads share the guest's one processor
    made = OneRig(replace(PATIENT, rate=25), interface='socketcan', channel='vcan0')
    yield made
    made.close()


@pytest.mark.parametrize(('row', 'situation'), [
    *ROWS, ('bus-off', 'moving'), ('TPDO missing', 'moving')])
def test_the_fault_table_holds_on_a_real_bus(one_rig, vcan0, row, situation):
    prove_patiently(one_rig, row, situation, tries=2)
