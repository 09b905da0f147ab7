"""Kinematics, compensation and drives of a 3-DOF parallel façade-cleaning manipulator."""

from facade_manipulator.resources import config_path

__all__ = ['config_path']
