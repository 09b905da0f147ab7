"""Simulated world, studies, benches and demo: no machine needs them."""
