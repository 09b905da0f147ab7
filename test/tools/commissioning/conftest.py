"""Fixtures: simulated drives and the tool."""

from __future__ import annotations

from commission_rig import CommissionRig, Terminal
import pytest


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


@pytest.fixture
def sit(monkeypatch):
    """Return what sits down at a terminal, which is stdin and stdout of the test."""
    terminals = []

    def make(read=lambda text: None) -> Terminal:
        terminals.append(Terminal(monkeypatch, read))
        return terminals[-1]

    yield make
    monkeypatch.undo()
    for terminal in terminals:
        terminal.hang_up()
