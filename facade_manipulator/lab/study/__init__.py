"""
Where the head can go and how well: limits, maps, good-condition workspace, design study.

In: a `Geometry`, or requirements of one. Out: designs that meet them, areas, measures of the
workspace and, from `study.study`, figures and tables. Built on `kinematics`; knows no time.
"""
