"""Measure the compensation: ``python -m facade_manipulator.simulation.bench``."""
