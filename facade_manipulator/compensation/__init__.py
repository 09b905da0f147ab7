"""
Compensation: computes the pose of the head on the rail from a goal and the disturbance.

The inputs, each with its time, are goals in frame `facade`, estimates of the disturbance, wrench
and lateral offset of the contact, and the head's measured pose. The output is a `CorrectedPose` in
frame `rail` for a given instant, within the workspace and the limits of motion. The package uses
no ROS, clock or I/O.
"""
