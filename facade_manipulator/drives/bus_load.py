"""
Worst-case load of the bus, which the control loop checks before it opens the bus.

The sum contains SYNC, the PDOs of all drives, the heartbeats and one SDO exchange per cycle. Each
frame has the maximum number of stuff bits. Above half of the bus, EMCY and repeated frames would
delay the frames of the cycle, and supervision would report drives that work.

References
----------
K. Tindell, A. Burns, A. Wellings, "Calculating controller area network (CAN) message response
times", Control Engineering Practice 3 (1995) 1163-1169,
https://doi.org/10.1016/0967-0661(95)00112-8.
"""

from __future__ import annotations

from collections.abc import Sequence

from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.profile import DriveProfile
from facade_manipulator.errors import compared, ParameterError

MAX_LOAD = 0.5  # share of the bit rate
FASTEST_SDO = 200  # Hz, maximum rate at which drives answer SDO requests


def bus_load(
    settings: ControllerSettings, bitrate: int, profiles: Sequence[DriveProfile]
) -> float:
    """Return the share of a bit rate [bit/s] that master and drives use at most."""
    pdos = 0.0  # bits per cycle
    for profile in profiles:
        for one in profile.pdos:
            pdos += longest_frame(one.codec.size) / one.transmission(settings.rate)
    cyclic = settings.rate * (longest_frame(0) + pdos)
    nodes = len(profiles) + 1  # with the master
    heartbeats = nodes / settings.heartbeat_period * longest_frame(1)
    request_and_answer = 2 * longest_frame(8)
    sdo = min(settings.rate, FASTEST_SDO) * request_and_answer
    return (cyclic + heartbeats + sdo) / bitrate


def check_bus_load(
    settings: ControllerSettings, bitrate: int, profiles: Sequence[DriveProfile]
) -> None:
    """Raise a ParameterError if the load is above `MAX_LOAD` at a bit rate [bit/s]."""
    load = bus_load(settings, bitrate, profiles)
    if load > MAX_LOAD:
        load_text, limit = compared(100.0 * load, 100.0 * MAX_LOAD, '.0f')
        raise ParameterError(
            f'bus load = {load_text} % at controller.rate = {settings.rate} Hz and '
            f'bus.bitrate = {bitrate} bit/s is above the limit {limit} %; '
            'next: increase the bit rate, reduce controller.rate, or map fewer objects in the '
            'profile'
        )


def longest_frame(size: int) -> int:
    """Return the bits of the longest frame with a number of data bytes and the next pause."""
    stuffed = 34 + 8 * size  # bits that the rule of bit stuffing covers
    return 47 + 8 * size + (stuffed - 1) // 4
