"""How much the black box keeps, and where."""

from __future__ import annotations

from facade_manipulator.parameters import parameter, settings
from facade_manipulator.resources import STATE_FOLDER


@settings
class BlackBoxSettings:
    """What of the past is in a file, and how many files there may be."""

    folder: str = parameter(
        'Folder of the files; made if it is not there', default=STATE_FOLDER)
    duration: float = parameter(
        'How long before a stop a file begins', default=120.0, unit='s', minimum=1.0,
        maximum=3600.0)
    aftermath: float = parameter(
        'How long after a stop a file goes on', default=3.0, unit='s', minimum=0.0, maximum=60.0)
    memory: float = parameter(
        'Memory for what waits for the disk; where it does not suffice, the oldest is lost',
        default=128.0, unit='MB', minimum=1.0, maximum=4096.0)
    disk: float = parameter(
        'Space for all files of this machine, half of it at most for the stream; the oldest is '
        'deleted when they need more',
        default=1000.0, unit='MB', minimum=1.0, maximum=1e6)
