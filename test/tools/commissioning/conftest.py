"""Fixtures: simulated drives and the tool."""

from __future__ import annotations

from commission_rig import CommissionRig
import pytest


@pytest.fixture
def make_rig(simulated_time, tmp_path):
    """Return what makes a rig from the options of `drive_simulator`."""
    rigs = []

    def make(*options: str) -> CommissionRig:
        rigs.append(CommissionRig(tmp_path, *options))
        return rigs[-1]

    yield make
    for rig in rigs:
        rig.close()
