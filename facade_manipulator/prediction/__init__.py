"""
Prediction of the disturbance: its estimates in, its state of motion at a later time out.

`EstimateGate` rejects estimates that cannot be true, `make_predictor` gives what predicts from
those that remain.
"""

from facade_manipulator.prediction.estimate import (
    Estimate,
    EstimateGate,
    EstimateMean,
    EstimateSettings,
    Variances,
)
from facade_manipulator.prediction.plain import make_predictor
from facade_manipulator.prediction.predictor import PredictionSettings

__all__ = [
    'Estimate',
    'EstimateGate',
    'EstimateMean',
    'EstimateSettings',
    'make_predictor',
    'PredictionSettings',
    'Variances',
]
