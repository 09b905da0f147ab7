"""
Prediction of the disturbance.

In go estimates of where the rail is in the façade's frame, each with its stamp and the variances
of its noise; out come position and velocity of the rail at any time, and how far off they may be.
"""

from __future__ import annotations

from facade_manipulator.prediction.plain import AccelerationPrediction, HeldPrediction
from facade_manipulator.prediction.predictor import DisturbancePredictor
from facade_manipulator.prediction.settings import PredictionSettings, RETIRED

__all__ = [
    'DisturbancePredictor', 'make_predictor', 'PredictionSettings', 'Predictor', 'RETIRED']

Predictor = DisturbancePredictor | HeldPrediction
PREDICTORS = {
    'continuation': DisturbancePredictor,
    'acceleration': AccelerationPrediction,
    'none': HeldPrediction,
}


def make_predictor(settings: PredictionSettings) -> Predictor:
    """Return the predictor of the settings' model."""
    return PREDICTORS[settings.model](settings)
