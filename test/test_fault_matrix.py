"""Every row of the fault table, met while inactive, homing, at rest and moving."""

from __future__ import annotations

from fault_rig import StreamRig
from fault_table import axes_for, cases, prove
import pytest


class OneRig:
    """The rig in use: shared by cases in a row, given up after a failure."""

    def __init__(self) -> None:
        self._rig: StreamRig | None = None
        self._axes = None

    def get(self, axes) -> StreamRig:
        if self._rig is None or axes is not self._axes:
            self.close()
            self._axes = axes
            self._rig = StreamRig(f'fault matrix {id(axes)}', axes=axes)
        return self._rig

    def close(self) -> None:
        rig, self._rig = self._rig, None
        if rig is not None:
            rig.close()


@pytest.fixture(scope='module')
def one_rig():
    made = OneRig()
    yield made
    made.close()


@pytest.mark.parametrize(('row', 'situation'), cases())
def test_the_fault_table_holds(one_rig, row, situation):
    try:
        prove(one_rig.get(axes_for(situation)), row, situation)
    except BaseException:
        one_rig.close()
        raise
