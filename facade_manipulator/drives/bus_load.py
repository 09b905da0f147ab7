"""
Worst-case load of the bus, and how often each PDO may be sent within it.

References
----------
K. Tindell, A. Burns, A. Wellings, "Calculating controller area network (CAN) message response
times", Control Engineering Practice 3(8), 1995: longest frame with stuff bits.

"""

from __future__ import annotations

from collections.abc import Iterable
from math import ceil

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.pdo import Pdo
from facade_manipulator.drives.axis_settings import AXIS_NAMES
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.errors import ParameterError

MAX_BUS_LOAD = 0.5  # of the bus: SDO, EMCY and repeated frames need room as well
_HEARTBEAT_BYTES = 1
_SDO_BYTES = 8
_FASTEST_SDO = 200.0  # exchanges per second that a drive and a worker thread manage at best
_HIGHEST_FULL_RATE = 200  # Hz
_REDUCED_RATES = {True: 50, False: 10}  # Hz, in faster cycles: with motion in it, without


def frame_bits(length: int) -> int:
    """Return the bits of the longest frame of `length` bytes, interframe space included."""
    # 8n + 47, and (34 + 8n - 1) / 4 stuff bits, rounded down
    return 10 * length + 55


def transmission_type(one: Pdo, rate: int) -> int:
    """
    Return every how many SYNCs a PDO is sent.

    Up to 200 Hz it is the map's own figure. In faster cycles there is no room for all of them:
    velocity and condition are then sent at about 50 Hz and 10 Hz.

    """
    is_needed = not one.is_transmitted or one.carries(pdo.STATUS)
    if rate <= _HIGHEST_FULL_RATE or is_needed:
        return one.transmission
    return ceil(rate / _REDUCED_RATES[one.carries(pdo.MOTION)])


def check_bus_load(
    settings: ControllerSettings, bitrate: int,
    maps: tuple[Iterable[Pdo], ...] = (pdo.PDO_MAP,) * len(AXIS_NAMES),
) -> float:
    """
    Return the worst-case share of the bus that the cyclic traffic takes.

    SYNC, the PDOs of all axes, all heartbeats, and SDO exchanges as fast as they can be. Raises a
    ParameterError above `MAX_BUS_LOAD`.
    """
    answers = sum(
        frame_bits(one.codec.size) / transmission_type(one, settings.rate)
        for pdos in maps for one in pdos)
    cyclic = settings.rate * (frame_bits(0) + answers)
    heartbeats = (len(maps) + 1) / settings.heartbeat_period * frame_bits(_HEARTBEAT_BYTES)
    sdo = min(settings.rate, _FASTEST_SDO) * 2 * frame_bits(_SDO_BYTES)
    load = (cyclic + heartbeats + sdo) / bitrate
    if load > MAX_BUS_LOAD:
        raise ParameterError(
            f'bus load = {100 * load:.0f} % at {settings.rate} Hz and {bitrate} bit/s is '
            f'above its bound {100 * MAX_BUS_LOAD:.0f} %: lower the rate or raise the '
            'bit rate')
    return load
