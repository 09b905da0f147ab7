"""What tests of the drive controller share."""

from bus_world import Rig
import pytest


@pytest.fixture
def make_rig():
    """Make drive controllers on a fake bus with three simulated drives."""
    rigs = []

    def make(**details):
        rigs.append(Rig(**details))
        return rigs[-1]

    yield make
    for rig in rigs:
        rig.close()


@pytest.fixture
def rig(make_rig):
    """Make one drive controller on a fake bus with three simulated drives."""
    return make_rig()
