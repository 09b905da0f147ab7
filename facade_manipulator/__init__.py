"""Kinematics, compensation and drives of a 3-DOF parallel façade-cleaning manipulator."""

from .resources import config_path as config_path
