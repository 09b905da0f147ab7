"""
Drives of independent make on a CAN bus of the kernel's: all frames, and one that is missing.

`test/drives/controller/test_drives_of_another_make.py` has all that they are asked for.
"""

import pytest

pytest.importorskip('durand', reason='the CANopen stack of the foreign drives is not installed')
from foreign_checks import prove  # noqa: E402
from support import patiently  # noqa: E402


@pytest.mark.realtime
@pytest.mark.parametrize('check', [
    'they_are_configured_homed_and_moved', 'a_dead_master_is_missed_by_its_heartbeat'])
def test_of_drives_of_independent_make_on_vcan(vcan0, tmp_path, check):
    patiently(lambda: prove(check, tmp_path, 'socketcan', vcan0))
