"""
The world around the manipulator: gondola, wind, wall, estimator, and scenarios made of them.

In: a `Scenario` and time. Out: the true disturbance, delayed and noisy estimates, the wrench on
the head and its error on the wall. Only programs that draw import `pictures`.
"""
