"""
Simulated CiA 402 drives on any python-can bus: frames and time in, frames out.

``python -m facade_manipulator.drives.simulated`` starts three of them; tests inject faults.
"""

from facade_manipulator.drives.simulated.bus import DriveSimulator
from facade_manipulator.drives.simulated.group import simulated_drives

__all__ = [
    'DriveSimulator',
    'simulated_drives',
]
