"""Every row of the fault table, met while inactive, homing, at rest and moving."""

from __future__ import annotations

from fault_rig import OneRig
from fault_table import cases, prove
import pytest


@pytest.fixture(scope='module')
def one_rig(shared_time):
    made = OneRig()
    yield made
    made.close()


@pytest.mark.parametrize(('row', 'situation'), cases())
def test_the_fault_table_holds(one_rig, row, situation):
    prove(one_rig.get(situation), row, situation)
