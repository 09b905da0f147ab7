"""The CAN bus of a tool: a thread that receives, and objects, answers and frames for who asks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
import threading
import time

from canopen.lss import LssMaster

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.bus import can_bus, CanBus, Frame
from facade_manipulator.canopen.link import BusSettings, open_bus
from facade_manipulator.canopen.nmt import NmtCommand, NmtState
from facade_manipulator.canopen.sdo import Patience, PumpedNetwork, SdoChannel
from facade_manipulator.errors import (
    BusError,
    CommissioningError,
    DriveError,
    DriveStateError,
    DriveTimeoutError,
    ManipulatorError,
)

LISTENING_TIME = 0.6  # s: the longest period of a driver's heartbeat, and something
BOOT_TIMEOUT = 5.0  # s
_RECEIVING = 0.05
NODE_IDS = range(1, pdo.MASTER_NODE_ID)
STORING = Patience(timeout=5.0, attempts=1)  # a second attempt would store what is there then


class ToolBus:
    """
    The bus while a tool of commissioning has it; `latest` has the newest frame by COB-ID.

    Raises a BusError if the interface is missing, down or at another bit rate.
    """

    def __init__(self, settings: BusSettings) -> None:
        self.settings = settings
        self.frames = can_bus(open_bus(settings))
        self.network = PumpedNetwork(self.frames)
        self.latest: dict[int, Frame] = {}
        self._collected: list[Frame] = []
        self._error: BusError | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name='tool bus', daemon=True)
        self._thread.start()

    def __enter__(self) -> ToolBus:
        return self

    def __exit__(self, *details: object) -> None:
        self.hand_over().close()

    def hand_over(self) -> CanBus:
        """Receive nothing more, and return the bus for somebody who does so himself."""
        self._closing.set()
        self._thread.join()
        return self.frames

    def _run(self) -> None:
        while not self._closing.is_set() and self._error is None:
            try:
                frame = self.frames.receive(_RECEIVING)
            except BusError as error:
                self._error = error
                return
            if frame is not None:
                self.latest[frame.cob_id] = frame
                self._collected.append(frame)
                self.network.feed(frame)

    def check(self) -> None:
        """Raise a BusError if the bus was lost."""
        if self._error is not None:
            raise self._error

    def command(self, command: NmtCommand, node_id: int = 0) -> None:
        """Send a network management command, to all nodes by default; raises a BusError."""
        self.check()
        self.frames.command(command, node_id)

    def collect(self, duration: float, ask: Callable[[], None] = lambda: None) -> list[Frame]:
        """Ask for something, wait, and return all frames that were received meanwhile."""
        self._collected.clear()
        ask()
        time.sleep(duration)
        self.check()
        return list(self._collected)

    def wait_for(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Wait until a condition holds; return whether it does."""
        end = time.monotonic() + timeout
        while not condition():
            self.check()
            if time.monotonic() > end:
                return False
            time.sleep(0.002)
        return True

    def objects(
        self, node_id: int, name: str = '', eds: Path | None = None,
        patience: Patience | None = None,
    ) -> SdoChannel:
        """Return the objects of a drive, for the newest caller, as `SdoChannel` takes them."""
        return SdoChannel(self.network, node_id, name or f'node {node_id}', eds, patience)

    def lss(self, timeout: float) -> LssMaster:
        """Return a master of the layer setting services, with a time-out for each answer [s]."""
        master = LssMaster()
        master.network = self.network
        master.RESPONSE_TIMEOUT = timeout
        self.network.subscribers[LssMaster.LSS_RX_COBID] = [master.on_message_received]
        return master

    def reset(self, node_id: int) -> None:
        """Reset a drive and wait until it is back; raises a DriveTimeoutError if it is not."""
        self.latest.pop(pdo.heartbeat_cob_id(node_id), None)
        self.command(NmtCommand.RESET_NODE, node_id)
        if not self.wait_for(lambda: self.nmt_state(node_id) is not None, BOOT_TIMEOUT):
            raise DriveTimeoutError(
                f'node {node_id} sent no boot-up message within {BOOT_TIMEOUT:g} s of its reset: '
                'check its power')

    def start(self, node_id: int) -> None:
        """Start a drive's process data; raises a DriveTimeoutError if it does not confirm that."""
        self.command(NmtCommand.START, node_id)
        if not self.wait_for(
                lambda: self.nmt_state(node_id) == NmtState.OPERATIONAL, BOOT_TIMEOUT):
            raise DriveTimeoutError(
                f'node {node_id} did not confirm by its heartbeat within {BOOT_TIMEOUT:g} s that '
                'it is operational')

    def nmt_state(self, node_id: int) -> NmtState | None:
        """Return the state that a node's newest heartbeat names, None for none."""
        beat = self.latest.get(pdo.heartbeat_cob_id(node_id))
        number = beat.data[0] & 0x7F if beat is not None and beat.data else None
        return NmtState(number) if number in set(NmtState) else None

    def require_alone(self) -> None:
        """Listen whether a driver runs on this bus; raises a DriveStateError if one does."""
        received = {frame.cob_id for frame in self.collect(LISTENING_TIME)}
        for cob_id, (what, _) in pdo.frames_of_masters(NODE_IDS).items():
            if cob_id in received:
                raise DriveStateError(
                    f'a driver runs on this bus, {self.frames}, or another tool: {what} was '
                    'received, and two masters must not command one drive; end it, then try again')


@contextmanager
def stating(state: Callable[[], str]) -> Iterator[None]:
    """Add in which state the drives are to what ends something, Ctrl-C too."""
    try:
        yield
    except (ManipulatorError, KeyboardInterrupt) as error:
        raise CommissioningError(
            f'{str(error) or "stopped by Ctrl-C"}. {state()}') from error


def number_or_none(drive: SdoChannel, index: int, subindex: int = 0) -> int | None:
    """Read an object that is a number; None where the drive does not say it."""
    with suppress(DriveError):
        return drive.read_number(index, subindex)
    return None
