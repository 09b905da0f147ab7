"""The models of the prediction by name."""

from __future__ import annotations

from facade_manipulator.prediction.plain import AccelerationPrediction, HeldPrediction
from facade_manipulator.prediction.predictor import DisturbancePredictor
from facade_manipulator.prediction.settings import PredictionSettings

Predictor = DisturbancePredictor | HeldPrediction
PREDICTORS = {
    'continuation': DisturbancePredictor,
    'acceleration': AccelerationPrediction,
    'none': HeldPrediction,
}


def make_predictor(settings: PredictionSettings) -> Predictor:
    """Return the predictor of the settings' model."""
    return PREDICTORS[settings.model](settings)
