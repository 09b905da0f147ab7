"""Simulated machine and its world. No module of the machine imports this package."""
