"""
Simulated CiA 402 drives on any python-can bus: frames and time in, frames out.

``python -m facade_manipulator.drives.simulated`` starts three of them; tests inject faults.
"""

from facade_manipulator.drives.simulated.drive import simulated_drives
from facade_manipulator.drives.simulated.simulator import DriveSimulator

__all__ = [
    'DriveSimulator',
    'simulated_drives',
]
