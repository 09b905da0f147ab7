"""A fixture for rejected commands and their messages."""

from __future__ import annotations

import pytest


@pytest.fixture
def rejected(capsys):
    """Return a function that runs a command, requires exit status 1 and returns its errors."""
    def run(command, *arguments, **options):
        assert command(*arguments, **options) == 1
        return capsys.readouterr().err

    return run
