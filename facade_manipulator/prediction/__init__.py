"""
Prediction of the disturbance: its estimates in, its state of motion at a later time out.

`EstimateGate` rejects estimates that cannot be true. `make_predictor` gives what predicts from
those that remain, each with its stamp and the variances of its noise: position and velocity of the
rail in the façade's frame at any time, and how far off they may be.
"""

from facade_manipulator.prediction.estimate import (
    Estimate,
    EstimateGate,
    EstimateMean,
    EstimateSettings,
    Variances,
)
from facade_manipulator.prediction.models import make_predictor, Predictor
from facade_manipulator.prediction.predictor import DisturbancePredictor
from facade_manipulator.prediction.settings import PredictionSettings

__all__ = [
    'DisturbancePredictor',
    'Estimate',
    'EstimateGate',
    'EstimateMean',
    'EstimateSettings',
    'make_predictor',
    'PredictionSettings',
    'Predictor',
    'Variances',
]
