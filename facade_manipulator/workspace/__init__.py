"""
Where the head can go and how well: limits, maps, good-condition workspace, design study.

In: a `Geometry` and a pose, a section or a grid. Out: intervals, areas, maps of conditioning
and, from `workspace.study`, figures and tables of the design. Built on `kinematics`; knows no
time.
"""

from facade_manipulator.workspace.gcw import count_poses, Grid, PoseCount
from facade_manipulator.workspace.limits import Interval, theta_max, x_interval, y_range
from facade_manipulator.workspace.maps import (
    lci_grid,
    pose_map,
    PoseMap,
    x_intervals,
)
from facade_manipulator.workspace.volume import measure, union_area, Workspace

__all__ = [
    'count_poses',
    'Grid',
    'Interval',
    'lci_grid',
    'measure',
    'pose_map',
    'PoseCount',
    'PoseMap',
    'theta_max',
    'union_area',
    'Workspace',
    'x_interval',
    'x_intervals',
    'y_range',
]
