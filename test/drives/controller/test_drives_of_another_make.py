"""The driver on drives of independent make; `test/socketcan` has them on a bus of the kernel's."""

import pytest

pytest.importorskip('durand', reason='the CANopen stack of the foreign drives is not installed')
from foreign_checks import CHECKS, prove  # noqa: E402


@pytest.mark.parametrize('check', CHECKS)
def test_of_drives_of_independent_make(simulated_time, tmp_path, check):
    prove(check, tmp_path, 'virtual', check)
