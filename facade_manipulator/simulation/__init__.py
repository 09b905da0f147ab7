"""Simulated machine and its world, which no module of the real machine imports."""
