"""
Simulated CiA 402 drives for any python-can bus: frames and time in, frames out.

``python -m facade_manipulator.simulation.drives`` starts three drives.
"""
