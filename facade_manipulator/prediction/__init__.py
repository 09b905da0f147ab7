"""
Prediction of the disturbance: its estimates in, its state of motion at a later time out.

`EstimateGate` rejects estimates that cannot be true. `DisturbancePredictor` predicts from those
that remain, each with its stamp and the variances of its noise: position and velocity of the rail
in the façade's frame at any time, and how far off they may be.
"""

from .estimate import ALL_KNOWN as ALL_KNOWN
from .estimate import Estimate as Estimate
from .estimate import EstimateGate as EstimateGate
from .estimate import EstimateMean as EstimateMean
from .estimate import EstimateSettings as EstimateSettings
from .estimate import Variances as Variances
from .mounting import estimator_motion as estimator_motion
from .mounting import rail_pose as rail_pose
from .predictor import DisturbancePredictor as DisturbancePredictor
from .predictor import PredictionSettings as PredictionSettings
