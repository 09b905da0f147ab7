"""
Where the head can go and how well: limits, maps, good-condition workspace, design study.

In: a `Geometry`, or requirements of one. Out: designs that meet them, areas, measures of the
workspace and, from `study.study`, figures and tables. Built on `kinematics`; knows no time.
"""

from .optimise import designs_of as designs_of
from .options import add_settings as add_settings
from .output import console as console
from .output import folder as folder
from .output import progress_bar as progress_bar
from .output import table as table
from .requirements import feasible as feasible
from .requirements import Requirements as Requirements
from .section import section_area as section_area
from .sweep import executor_of as executor_of
from .volume import measure as measure
