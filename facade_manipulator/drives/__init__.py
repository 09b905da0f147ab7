"""Drives: CiA 402 states, profiles, homing, the group of axes, the cycle and the controller."""
