"""A fixture: commands that say why they do nothing."""

from __future__ import annotations

import pytest


@pytest.fixture
def rejected(capsys):
    """Return what runs a command that ends with exit status 1, and returns what it says then."""
    def run(command, *arguments, **options):
        assert command(*arguments, **options) == 1
        return capsys.readouterr().err

    return run
