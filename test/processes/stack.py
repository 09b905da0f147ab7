"""Processes of the stack: parameters, and actions of an operator."""

from collections.abc import Callable
from contextlib import suppress
import os
import subprocess

from own_processes import Processes
from support import DEADLINE, patiently, wait_until

from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.client import ManipulatorClient, RequestRejectedError
from facade_manipulator.drives.states import State
from facade_manipulator.errors import ManipulatorError

# all processes share the guest's one CPU
RATE = 50  # Hz
PERIOD = 1.0 / RATE
DRIVER = (
    'controller.realtime_priority:=60',
    f'controller.rate:={RATE}',
    'limits.speed:=0.4',
    'q1.home_position:=-0.1',
    'q2.home_position:=0.1',
    'q3.home_position:=0.0',
)
# late cycles of a busy computer must fail only the tests of late cycles
PATIENCE = ('controller.max_missed_cycles:=10', 'controller.heartbeat_timeout:=0.5')


def promptly(priority: int) -> Callable[[], None]:
    """
    Return a function that gives a process a real-time priority, if that is permitted.

    A thread that holds the interpreter of a driver must not wait for other processes, because the
    control loop would wait with it. A guest has one processor.
    """

    def begin() -> None:
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))

    return begin


# the control loop itself: 60
as_drives = promptly(50)
as_driver = promptly(40)


def begun(process: subprocess.Popen, words: str) -> subprocess.Popen:
    """Return a process after words in its log; fail at once, with the log, if it ends."""

    def has_begun_or_ended() -> bool:
        return words in process.log.read_text() or process.poll() is not None

    wait_until(has_begun_or_ended, f'"{words}" in {process.log.name}', 60.0)
    assert process.poll() is None, process.log.read_text()
    return process


class Stack:
    """
    Drives and a driver that consecutive tests share.

    Parameters
    ----------
    domain : int
        ROS domain of the processes.
    folders : pytest.TempPathFactory
        Factory of the folders for logs.

    """

    def __init__(self, domain: int, folders) -> None:
        self.domain = domain
        self.channel = f'stack-{domain}'
        self._folders = folders
        self._details: tuple = ()
        self._processes: Processes | None = None
        self._driver: subprocess.Popen | None = None

    def get(self, bus: BusSettings, parameters: tuple[str, ...]) -> subprocess.Popen:
        """Return a driver with these parameters; start a new driver if none runs."""
        details = bus, parameters
        if self._driver and self._driver.poll() is None and self._details == details:
            return self._driver
        self.end()
        self._details = details
        self._processes = Processes(self._folders.mktemp('stack'))
        values = (
            f'bus.interface:={bus.interface}',
            f'bus.channel:={bus.channel}',
            *DRIVER,
            *parameters,
        )
        drives = self._processes.start(
            'facade_manipulator.simulation.drives',
            *('--interface', bus.interface),
            *('--channel', bus.channel),
            preexec_fn=as_drives,
        )
        begun(drives, 'nodes 1, 2, 3')
        words = ['--ros-args']
        for value in values:
            words += ['-p', value]
        driver = self._processes.start(
            'facade_manipulator.nodes.driver', *words, preexec_fn=as_driver
        )
        self._driver = begun(driver, 'ready')
        return self._driver

    def end(self) -> None:
        """End drives and driver, so that others can use the bus."""
        if self._processes:
            self._processes.end()
        self._processes = None
        self._driver = None


def bring_up(client: ManipulatorClient) -> None:
    """Power the drives on like an operator; retry if this computer was too busy."""

    def up() -> None:
        client.configure()
        client.home()
        client.activate()

    patiently(up, lambda: come_down(client), (ManipulatorError,))


def go_on(client: ManipulatorClient) -> None:
    """Activate after a stop; start from configure if this computer was too busy."""

    def start_again() -> None:
        come_down(client)
        client.configure()
        client.home()

    patiently(client.activate, start_again, (RequestRejectedError,), tries=2)


def come_down(client: ManipulatorClient) -> None:
    """Leave the drives without power and the bus closed, in any state of the driver."""
    ways = {'active': client.deactivate, 'inactive': client.cleanup}

    def is_down() -> bool:
        # the driver was busy, or has left that state by itself
        with suppress(ManipulatorError):
            state = client.driver_state()
            if state in ways:
                ways[state]()
            return state == 'unconfigured'
        return False

    client.wait_until(is_down, 'the driver to be unconfigured', 30.0)


def make_sure_of_power(client: ManipulatorClient, watcher) -> None:
    """Wait for three enabled drives; power them on again if this computer was too busy."""

    def start_again() -> None:
        come_down(client)
        bring_up(client)

    patiently(lambda: wait_until_enabled(watcher, 2.0), start_again)


def wait_until_enabled(watcher, deadline: float = DEADLINE) -> None:
    def is_enabled() -> bool:
        if watcher.first(0x77F, 0.0) is None:
            return False
        return watcher.states() == [State.OPERATION_ENABLED] * 3

    event = 'three enabled drives and a heartbeat of their master'
    wait_until(is_enabled, event, deadline)
