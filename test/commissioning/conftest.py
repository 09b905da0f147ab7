"""Fixtures: simulated drives and the tool."""

from __future__ import annotations

from types import SimpleNamespace

from commission_rig import CommissionRig
import pytest

from facade_manipulator.commissioning import bus, motion


@pytest.fixture(autouse=True)
def _without_pauses(monkeypatch):
    """Let the library's LSS master go on at once: simulated drives need no pauses."""
    monkeypatch.setattr('canopen.lss.time', SimpleNamespace(sleep=lambda seconds: None))


@pytest.fixture(autouse=True)
def patient(monkeypatch, request):
    """Bear a busy computer, but where the time of a stop is measured; listen less long."""
    monkeypatch.setattr(bus, 'LISTENING_TIME', 0.2)
    if 'stop_times' not in request.fixturenames:
        monkeypatch.setattr(motion, 'HEARTBEAT_TIMEOUT', 0.5)
        monkeypatch.setattr(motion, '_MISSED', 40)


@pytest.fixture
def stop_times():
    """Return where a test notes how long stops took, under the true time-outs."""
    return []


@pytest.fixture
def make_rig(tmp_path):
    """Return what makes a rig from the options of `drive_simulator`."""
    rigs = []

    def make(*options: str) -> CommissionRig:
        rigs.append(CommissionRig(tmp_path, *options))
        return rigs[-1]

    yield make
    for rig in rigs:
        rig.close()
