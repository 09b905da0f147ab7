"""The paper computed again: workspace, conditioning, singularities, optimum, tables, figures."""
