"""Where nothing answers: at which bit rate there are frames."""

from __future__ import annotations

from collections.abc import Callable
import subprocess
import time

import can

from facade_manipulator.drives.canopen import BusSettings
from facade_manipulator.errors import CommissioningError
from facade_manipulator.tools.commissioning.operator import Operator

BIT_RATES = (1_000_000, 500_000, 250_000, 125_000)
_LISTENING = 1.0  # s


def guess_bitrate(settings: BusSettings, operator: Operator, may_change: bool) -> None:
    """
    Listen at the usual bit rates, without a bit sent, and say where frames come.

    Raises a CommissioningError if the interface cannot be set; it needs root.
    """
    operator.say(
        'Nothing answers: power, plugs, termination (60 ohms between CAN high and low), or '
        f'another bit rate than {settings.bitrate}.')
    if not may_change or settings.interface != 'socketcan':
        operator.say('commission scan --guess-bitrate, as root, tries the usual ones.')
        return
    operator.agree(f'{settings.channel} is set to listen-only at '
                   f'{", ".join(map(str, BIT_RATES))} bit/s, then back; the drives must be on: '
                   'switch their power off and on meanwhile, so that they send boot-ups.')
    found = None
    try:
        found = find_bitrate(settings.channel, set_link, count_frames)
    finally:  # whatever ended the search, Ctrl-C too
        set_link(settings.channel, found or settings.bitrate, listen_only=False)
    operator.say(f'Frames at {found} bit/s: --bitrate {found}, or set the drives to '
                 f'{settings.bitrate}.' if found else 'No frames at any of them.')


def find_bitrate(
    channel: str, configure: Callable[[str, int, bool], None],
    count: Callable[[str], tuple[int, int]],
) -> int | None:
    """Return the first bit rate at which frames come and no errors, None for none."""
    for bitrate in BIT_RATES:
        configure(channel, bitrate, True)
        frames, errors = count(channel)
        if frames and not errors:
            return bitrate
    return None


def set_link(channel: str, bitrate: int, listen_only: bool) -> None:
    """Set a SocketCAN interface; raises a CommissioningError."""
    mode = 'on' if listen_only else 'off'
    for command in (['down'], ['type', 'can', 'bitrate', str(bitrate), 'listen-only', mode],
                    ['up']):
        done = subprocess.run(['ip', 'link', 'set', channel, *command],
                              capture_output=True, text=True)
        if done.returncode:
            raise CommissioningError(
                f'ip link set {channel} {" ".join(command)}: {done.stderr.strip()}; look at the '
                f'interface with ip -details link show {channel}')


def count_frames(channel: str) -> tuple[int, int]:
    """Return how many frames and how many error frames come within a second."""
    frames = errors = 0
    with can.Bus(interface='socketcan', channel=channel) as bus:
        end = time.monotonic() + _LISTENING
        while (left := end - time.monotonic()) > 0.0:
            message = bus.recv(left)
            if message is not None:
                errors += message.is_error_frame
                frames += not message.is_error_frame
    return frames, errors
