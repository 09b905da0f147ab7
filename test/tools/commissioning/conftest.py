"""Fixtures: simulated drives, the tool, and a simulated clock."""

import pytest
from tools.commissioning.rig import CommissionRig


@pytest.fixture
def make_rig(tmp_path, monkeypatch):
    """Return a function that makes a rig from the options of `drive_simulator`."""
    made = []

    def make(*options: str) -> CommissionRig:
        made.append(CommissionRig(tmp_path, monkeypatch, *options))
        return made[-1]

    make.made = made
    return make


@pytest.fixture
def rig(make_rig):
    """Return three drives that have their node ids."""
    return make_rig().configured()


@pytest.fixture
def rejected(make_rig, capsys):
    """Return a function that runs a command, requires its rejection and returns the message."""

    def run(*words: str, **options: bool) -> str:
        assert make_rig.made[-1].run(*words, **options) in (1, 130)
        return capsys.readouterr().err

    return run
