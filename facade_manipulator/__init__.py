"""Kinematics, compensation and drives of a 3-DOF parallel façade-cleaning manipulator."""
