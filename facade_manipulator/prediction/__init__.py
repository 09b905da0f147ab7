"""
Prediction of the disturbance: its estimates in, its state of motion at a later time out.

`EstimateGate` rejects estimates that cannot be true. `DisturbancePredictor` predicts from those
that remain, each with its stamp and the variances of its noise: position and velocity of the rail
in the façade's frame at any time, and how far off they may be.
"""
