"""
Simulated CiA 402 drives on any python-can bus: frames and time in, frames out.

``python -m facade_manipulator.lab.drives`` starts three of them; tests inject faults.
"""

from .drive import simulated_drives as simulated_drives
from .simulator import DriveSimulator as DriveSimulator
from .simulator import start_simulator as start_simulator
