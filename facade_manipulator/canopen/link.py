"""
CAN interface: settings, counters, and checks that it exists, is up and has the right bit rate.

SocketCAN opens an interface that is down or uses another bit rate without an error. This module
checks both beforehand, with iproute2 if installed, otherwise in /sys.
The module imports no CAN library, because the driver node has no bus and saves the memory of the
library.
"""

from __future__ import annotations

from dataclasses import dataclass
import json
from pathlib import Path
import subprocess
from typing import Any

from facade_manipulator.errors import BusError
from facade_manipulator.parameters import parameter, settings

_SYSTEM = Path('/sys/class/net')


@settings
class BusSettings:
    """Settings of the CAN interface of the drives."""

    interface: str = parameter(
        'Type of CAN interface, as named by python-can', default='virtual'
    )
    channel: str = parameter('Name of the CAN interface', default='can0')
    bitrate: int = parameter(
        'Bit rate of the bus, of which the cycle uses at most half',
        default=1_000_000,
        unit='bit/s',
        minimum=10_000,
        maximum=1_000_000,
    )

    def missing(self) -> str:
        """Return why the bus cannot be opened yet, for example during start-up; else ``''``."""
        if self.interface != 'socketcan' or is_up(self.channel):
            return ''
        return (
            f'the CAN interface {self.channel} is missing or down; next: connect the '
            f'adapter, and sudo ip link set {self.channel} up'
        )


@dataclass
class BusStatistics:
    """Counters since the bus was opened, and the present state of the CAN controller."""

    received: int = 0
    sent: int = 0
    ignored: int = 0
    error_frames: int = 0
    overflows: int = 0
    condition: str = 'active'  #: or warning, passive, off


# Share of the bit rate by which the adapter may deviate. With the sample point 87.5 % of CiA 301,
# p = 0.125 bits follow the sample, and each node may deviate by p / (2 (13 - p)) = 0.49 % (Bosch,
# CAN specification 2.0). The crystals of drives deviate by less than 0.02 %.
BIT_RATE_TOLERANCE = 0.005
_NEAR_BIT_RATE = 0.1  # a larger deviation comes from a setting, not from a clock


def check_link(channel: str, bitrate: int) -> None:
    """Raise a BusError if an interface is missing, down or bus-off, or has another bit rate."""
    link = f'sudo ip link set {channel}'
    details = _details(channel)
    # vcan has no bit rate
    actual = details.get('bittiming', {}).get('bitrate', bitrate)
    deviation = abs(actual - bitrate) / bitrate
    if not (_SYSTEM / channel).exists():
        problem = 'is missing; next: ' + (
            f'sudo ip link add {channel} up type vcan'
            if channel.startswith('vcan')
            else 'connect its adapter, or correct the parameter bus.channel'
        )
    elif not is_up(channel):
        problem = f'is down; next: {link} up type can bitrate {bitrate}'
    elif deviation > _NEAR_BIT_RATE:
        problem = (
            f'runs at {actual} bit/s, not at {bitrate} bit/s; next: {link} down, then '
            f'{link} up type can bitrate {bitrate}'
        )
    elif deviation > BIT_RATE_TOLERANCE:
        problem = (
            f'runs at {actual} bit/s, {100.0 * deviation:.2g} % from {bitrate} bit/s, above the '
            f'limit {100.0 * BIT_RATE_TOLERANCE:g} %: the clock of its adapter cannot '
            'generate this bit rate; next: use another adapter or another bit rate'
        )
    elif details.get('state') == 'BUS-OFF':
        problem = f'is bus-off; next: check wiring and bit rate, then {restart_command(channel)}'
    else:
        return
    raise BusError(f'the CAN interface {channel} {problem}')


def restart_command(channel: str) -> str:
    """Return the command that restarts a bus-off controller if restart-ms is 0."""
    return f'sudo ip link set {channel} type can restart'


def is_up(channel: str) -> bool:
    """Return whether a network interface exists and is up."""
    try:
        flags = int((_SYSTEM / channel / 'flags').read_text(), 16)
    except (OSError, ValueError):
        return False
    return bool(flags & 1)  # IFF_UP


_QUERY_TIMEOUT = 2.0  # s, for `ip`


def _details(channel: str) -> dict[str, Any]:
    """Return the output of iproute2 about the CAN controller; empty without iproute2."""
    try:
        answer = subprocess.run(
            ['ip', '-json', '-details', 'link', 'show', 'dev', channel],
            capture_output=True,
            text=True,
            timeout=_QUERY_TIMEOUT,
            check=True,
        )
        return json.loads(answer.stdout)[0].get('linkinfo', {}).get('info_data', {})
    except (OSError, subprocess.SubprocessError, ValueError, LookupError):
        return {}
