"""The driver on drives of independent make, on a CAN bus of the kernel's."""

import pytest

pytest.importorskip('durand', reason='the CANopen stack of the foreign drives is not installed')
from foreign_checks import CHECKS, ForeignRig  # noqa: E402
from support import patiently  # noqa: E402


@pytest.mark.realtime
@pytest.mark.parametrize('check', CHECKS)
def test_of_drives_of_independent_make_on_vcan(vcan0, tmp_path, check):
    def run():
        rig = ForeignRig(tmp_path, 'socketcan', vcan0)
        try:
            CHECKS[check](rig)
        finally:
            rig.close()
    patiently(run)
