"""Fixtures for tests of the drive controller."""

from dataclasses import replace

from bus_world import Rig
import pytest
import yaml

from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.package_files import config_path


@pytest.fixture
def make_rig():
    """Return a function that makes drive controllers on a fake bus with three simulated drives."""
    rigs = []

    def make(**details):
        rigs.append(Rig(**details))
        return rigs[-1]

    yield make
    for rig in rigs:
        rig.close()


@pytest.fixture
def rig(make_rig):
    """Return a drive controller on a fake bus with three simulated drives."""
    return make_rig()


@pytest.fixture
def axes_with(tmp_path):
    """Return a function that makes axes with a changed drive type of the package."""

    def make(base='simulated', **changes):
        data = yaml.safe_load(config_path(f'drives/{base}.yaml').read_text())
        data |= {'eds': str(config_path(f'drives/{data["eds"]}')), **changes}
        path = tmp_path / 'mine.yaml'
        path.write_text(yaml.safe_dump(data, sort_keys=False))
        return tuple(replace(axis, profile=str(path)) for axis in DEFAULT_AXES)

    return make
