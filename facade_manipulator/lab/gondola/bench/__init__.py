"""Measure the compensation: ``python -m facade_manipulator.lab.gondola.bench``."""
