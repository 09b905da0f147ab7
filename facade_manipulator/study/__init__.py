"""Reproduction of the paper: workspace, conditioning, singularities, optimum, tables, figures."""
