"""How much the black box keeps, and where."""

from __future__ import annotations

from facade_manipulator.parameters import parameter, settings
from facade_manipulator.resources import STATE_FOLDER


@settings
class BlackBoxSettings:
    """What of the past is in a file, and how many files there may be."""

    folder: str = parameter(
        STATE_FOLDER, 'Folder of the files; made if it is not there')
    duration: float = parameter(
        120.0, 'How long before a stop a file begins', unit='s', minimum=1.0, maximum=3600.0)
    aftermath: float = parameter(
        3.0, 'How long after a stop a file goes on', unit='s', minimum=0.0, maximum=60.0)
    memory: float = parameter(
        128.0, 'Memory for what is kept; a file begins later where it does not suffice',
        unit='MB', minimum=1.0, maximum=4096.0)
    disk: float = parameter(
        1000.0, 'Space for all files of the folder; the oldest is deleted when they need more',
        unit='MB', minimum=1.0, maximum=1e6)
