"""Where the head can go and how well: limits, maps, good-condition workspace, design study."""

from facade_manipulator.workspace.limits import Interval, theta_max, x_interval, y_range

__all__ = ['Interval', 'theta_max', 'x_interval', 'y_range']
