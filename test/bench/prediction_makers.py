"""The prediction after a minute of sways, and its continuation alone: one estimate a call."""

from __future__ import annotations

from itertools import count
import math

RATE = 50.0  # Hz
LEARNT = 61.0  # s, more than the tones' window
AHEAD = 0.12  # s
FORECASTS = 2  # for each estimate, as the compensator asks for at 100 Hz
NOISE = 1e-3


def with_tones():
    """Learn and forecast as the compensator does."""
    import numpy as np

    from facade_manipulator.kinematics import Pose
    from facade_manipulator.prediction import DisturbancePredictor, PredictionSettings, Variances

    random, numbers = np.random.default_rng(0), count()
    predictor, variances = DisturbancePredictor(PredictionSettings()), Variances(*3 * [NOISE ** 2])

    def estimate():
        stamp = next(numbers) / RATE
        x, y, theta = NOISE * random.standard_normal(3)
        return stamp, Pose(0.1 * math.sin(0.7 * stamp) + 0.02 * math.sin(1.9 * stamp) + x,
                           0.01 * math.sin(stamp) + y, 0.03 * math.sin(0.9 * stamp) + theta)

    def learn():
        stamp, pose = estimate()
        predictor.update(stamp, pose, variances)
        for forecast in range(FORECASTS):
            predictor.predict(stamp + AHEAD + 0.01 * forecast)

    for _ in range(round(LEARNT * RATE)):
        learn()
    return learn, 1, []


def continuation_alone():
    """Do the same where tones are never fitted nor asked for."""
    import numpy as np

    from facade_manipulator.prediction.tones import Tones

    Tones.fit = Tones.add = lambda *_: None
    Tones.at = lambda self, stamp, ahead: np.zeros((3, len(ahead)))
    return with_tones()


MAKERS = {'prediction: with tones': with_tones, 'prediction: continuation': continuation_alone}
