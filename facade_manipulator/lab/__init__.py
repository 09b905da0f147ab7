"""Simulated world, studies and demo: no machine needs them."""
