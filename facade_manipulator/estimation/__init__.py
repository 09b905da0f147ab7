"""
Estimation of the rail's pose on the façade with commercial sensors.

The inputs, each with a stamp, are turning rates and accelerations, distances of the wall, places
of features, and poses. The outputs are pose and velocity of the rail with covariances, counts of
used and rejected measurements of each sensor, and events with their reasons.
"""
