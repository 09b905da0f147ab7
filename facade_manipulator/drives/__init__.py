"""Drives: CiA 402 states, profiles, homing, group of axes, cycle and controller."""
