"""
Pose of the rail on the façade, estimated from commercial sensors.

Inputs, each with a stamp: turning rates and accelerations, distances of the wall, places of
features, and poses. Outputs: pose and velocity of the rail with covariances, the number of used
and rejected measurements of each sensor, and events with their reasons.
"""
