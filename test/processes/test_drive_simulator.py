"""Drive simulator as a process on vcan0: raw frames in and out, the interface down and up."""

from __future__ import annotations

from contextlib import suppress
import struct

import can
from link import clear_flags, IFF_UP, set_flags
import pytest
from support import wait_until

MODULE = 'facade_manipulator.simulation.drives'
REQUEST = struct.pack('<BHB4x', 0x40, 0x1000, 0)  # SDO upload of the device type
ANSWER = bytes.fromhex('4300100092010200')


def ask(watcher, node):
    """Send an SDO request; return whether any request was answered."""
    with suppress(can.CanError):  # the interface is down
        watcher.send(0x600 + node, REQUEST)
    return ANSWER in [bytes(frame.data) for frame in watcher.of(0x580 + node)]


@pytest.fixture
def simulator(vcan0, start_process):
    process = start_process(MODULE, '--channel', vcan0)
    wait_until(lambda: 'nodes 1, 2, 3' in process.log.read_text(), 'the drive simulator')
    return process


def switch(interface, up):
    try:
        (set_flags if up else clear_flags)(interface, IFF_UP)
    except PermissionError:
        pytest.skip(f'no permission to switch {interface} {"up" if up else "down"}')


def test_simulated_drives_continue_after_interface_restart(simulator, watcher, vcan0):
    wait_until(lambda: ask(watcher, 1), 'drive 1')
    switch(vcan0, up=False)
    try:
        wait_until(lambda: not watcher.forget() and not ask(watcher, 1), 'silence')
    finally:
        switch(vcan0, up=True)
    watcher.forget()
    for node in (1, 2, 3):
        wait_until(lambda node=node: ask(watcher, node), f'drive {node} again')
    assert simulator.poll() is None
