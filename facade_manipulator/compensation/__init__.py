"""
The compensation: a goal on the wall and the disturbance in, the pose to send to the rail out.

In: goals in frame `facade`, estimates of the disturbance, wrench and lateral offset of the
contact, the head's measured pose, each with its time. Out: `CorrectedPose` in frame `rail`,
within the workspace and the limits of motion, for the instant it is meant for. Knows no ROS,
clock or I/O.
"""
