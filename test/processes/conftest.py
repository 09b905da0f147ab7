"""Fixtures: processes of the stack on a bus of the kernel, or on this machine's loopback."""

import itertools
import os
from pathlib import Path

from link import IFF_UP
from own_processes import free_domain
import pytest
from stack import bring_up, come_down, PATIENCE, Stack
from vcan import MISSING
from watcher import Watcher

from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.client import ManipulatorClient

FLAGS = Path('/sys/class/net/vcan0/flags')
FOLDER = Path(__file__).parent
_numbers = itertools.count()
_stacks: list[Stack] = []


@pytest.fixture(scope='session')
def stack(tmp_path_factory):
    """Return drives and a driver that consecutive tests share."""
    with free_domain() as domain:
        made = Stack(domain, tmp_path_factory)
        _stacks.append(made)
        yield made
        made.end()


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(nextitem):
    """End shared drives and driver before the tests of other folders: idle, they still compute."""
    if nextitem is None or FOLDER not in nextitem.path.parents:
        for made in _stacks:
            made.end()


@pytest.fixture
def ros_domain(stack, monkeypatch):
    """Return the ROS domain of the driver that the tests share."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(stack.domain))
    return stack.domain


@pytest.fixture
def vcan0() -> str:
    """Return the name of the virtual CAN interface, or skip with the reason for its absence."""
    if not FLAGS.exists():
        pytest.skip(os.environ.get(MISSING, 'no vcan0 here: run make test'))
    assert int(FLAGS.read_text(), 16) & IFF_UP, (
        'vcan0 is down: sudo ip link set vcan0 up'
    )
    return 'vcan0'


@pytest.fixture
def bus(request, stack) -> BusSettings:
    """Return the kernel's bus for tests with `vcan0`, and a bus between processes otherwise."""
    if 'vcan0' in request.fixturenames:
        return BusSettings('socketcan', request.getfixturevalue('vcan0'))
    shared = 'driver' in request.fixturenames
    return BusSettings(
        'loopback', stack.channel if shared else f'bus-{os.getpid()}-{next(_numbers)}'
    )


@pytest.fixture
def watcher(bus):
    """Return a receiver of all frames on the bus."""
    made = Watcher(bus)
    yield made
    made.close()


@pytest.fixture
def driver(bus, stack, ros_domain, request):
    """Return a driver with long timeouts, unless the marker `driver` of the test changes them."""
    marker = request.node.get_closest_marker('driver')
    process = stack.get(bus, marker.args if marker else PATIENCE)
    yield process
    print(process.log.read_text())


@pytest.fixture
def client(ros):
    """Return a client of an operator."""
    with ManipulatorClient() as made:
        yield made


@pytest.fixture
def active(driver, client):
    """Configure, home and activate the drives like an operator."""
    come_down(client)
    bring_up(client)
    return client
