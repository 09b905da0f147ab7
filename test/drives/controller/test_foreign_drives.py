"""The driver on drives of independent make, on the virtual bus; `test/socketcan` has a vcan."""

import pytest

pytest.importorskip('durand', reason='the CANopen stack of the foreign drives is not installed')
from foreign_checks import CHECKS, ForeignRig  # noqa: E402
from support import patiently  # noqa: E402


@pytest.mark.realtime
@pytest.mark.parametrize('check', CHECKS)
def test_of_drives_of_independent_make(tmp_path, request, check):
    def run():
        rig = ForeignRig(tmp_path, 'virtual', request.node.name)
        try:
            CHECKS[check](rig)
        finally:
            rig.close()
    patiently(run)
