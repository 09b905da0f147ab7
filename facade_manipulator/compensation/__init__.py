"""
Compensation: turn a goal on the wall and the disturbance into a pose of the head on the rail.

In: goals in frame `facade`, estimates of the disturbance, wrench and lateral offset of the
contact, the head's measured pose, each with its time. Out: `CorrectedPose` in frame `rail`,
within the workspace and the limits of motion, for a given instant. The package uses no ROS,
clock or I/O.
"""
