"""
Where the rail is on the façade, from sensors that can be bought.

In: turning rates and accelerations, distances of the wall, features or poses seen, each with its
stamp. Out: pose and velocity of the rail, with covariances that hold; what became of each sensor's
measurements, and events with their reasons.
"""
