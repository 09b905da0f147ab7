"""Kinematics, compensation and drives of a 3-DOF parallel façade-cleaning manipulator."""

from .package_files import config_path as config_path
