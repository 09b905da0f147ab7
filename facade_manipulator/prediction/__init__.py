"""
Prediction of the disturbance at a later time from estimates received so far.

`EstimateGate` rejects impossible estimates. `DisturbancePredictor` uses the other estimates, each
with its stamp and the variances of its noise. It predicts position and velocity of the rail in the
façade's frame at any time, and the standard deviations of their errors.
"""
