"""
Where the head can go and how well: limits, maps, good-condition workspace, design study.

In: a `Geometry` and a pose, a section or a grid. Out: intervals, areas, maps of conditioning
and, from `study.study`, figures and tables of the design. Built on `kinematics`; knows no
time.
"""

from .gcw import count_poses as count_poses
from .gcw import Grid as Grid
from .gcw import PoseCount as PoseCount
from .optimise import designs_of as designs_of
from .options import add_settings as add_settings
from .output import console as console
from .output import folder as folder
from .output import progress_bar as progress_bar
from .reach import Interval as Interval
from .reach import theta_max as theta_max
from .reach import y_range as y_range
from .requirements import feasible as feasible
from .requirements import margins as margins
from .requirements import Requirements as Requirements
from .section import section_area as section_area
from .sweep import executor_of as executor_of
from .sweep import Tick as Tick
from .volume import measure as measure
from .volume import union_area as union_area
from .volume import Workspace as Workspace
