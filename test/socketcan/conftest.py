"""Fixture: a vcan0 that is up, such as ``python vcan.py -- python -m pytest …`` finds."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from vcan import MISSING

FLAGS = Path('/sys/class/net/vcan0/flags')
IFF_UP = 0x1


@pytest.fixture
def vcan0() -> str:
    """Return the name of the virtual CAN interface, or skip with the reason why there is none."""
    if not FLAGS.exists():
        pytest.skip(os.environ.get(MISSING, 'no vcan0 here: run make test'))
    assert int(FLAGS.read_text(), 16) & IFF_UP, 'vcan0 is down: sudo ip link set vcan0 up'
    return 'vcan0'
