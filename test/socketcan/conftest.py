"""Fixtures: a vcan0 that is up, such as ``vcan.py`` provides, and the stack's processes on it."""

from __future__ import annotations

import os
from pathlib import Path

from link import IFF_UP
from listener import Listener
import pytest
import rclpy
from stack import as_driver, as_drives, bring_up, DRIVER, PATIENCE
from support import wait_until
from vcan import MISSING

from facade_manipulator.ros.client import ManipulatorClient

FLAGS = Path('/sys/class/net/vcan0/flags')


@pytest.fixture
def vcan0() -> str:
    """Return the name of the virtual CAN interface, or skip with the reason why there is none."""
    if not FLAGS.exists():
        pytest.skip(os.environ.get(MISSING, 'no vcan0 here: run make test'))
    assert int(FLAGS.read_text(), 16) & IFF_UP, 'vcan0 is down: sudo ip link set vcan0 up'
    return 'vcan0'


@pytest.fixture
def listener(vcan0):
    """Listen to all frames."""
    made = Listener(vcan0)
    yield made
    made.close()


@pytest.fixture
def drives(vcan0, start_process):
    """Start three simulated drives."""
    process = start_process(
        'facade_manipulator.drives.simulated', '--channel', vcan0, preexec_fn=as_drives)
    wait_until(lambda: 'nodes 1, 2, 3' in process.log.read_text(), 'the drive simulator', 60.0)
    return process


@pytest.fixture
def driver(drives, start_process, request):
    """Start the driver, patient with a busy computer unless the test says otherwise."""
    marker = request.node.get_closest_marker('driver')
    parameters = marker.args if marker else PATIENCE
    process = start_process(
        'facade_manipulator.nodes.driver', '--ros-args', *DRIVER,
        *(word for parameter in parameters for word in ('-p', parameter)), preexec_fn=as_driver)
    wait_until(lambda: 'ready' in process.log.read_text() or process.poll() is not None,
               'the driver', 60.0)
    assert process.poll() is None, process.log.read_text()
    return process


@pytest.fixture
def client(ros_domain):
    """Give an operator's client."""
    rclpy.init(domain_id=ros_domain)
    with ManipulatorClient() as made:
        yield made
    rclpy.try_shutdown()


@pytest.fixture
def active(driver, client):
    """Bring the drives up as an operator does: configure, home, activate."""
    bring_up(client)
    return client
