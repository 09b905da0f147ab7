"""Topic of the estimates: messages of a second topic are rejected while the first is used."""

from __future__ import annotations

import math

from facade_manipulator.compensation.correction import ESTIMATOR_SILENCE
from facade_manipulator.errors import InputError
from facade_manipulator.rejections import Rejections


class EstimateSource:
    """
    Topic whose estimates are used, out of several topics for the same disturbance.

    Two estimators differ in stamp and noise. If the estimates of both were used in turn, the
    correction would shake the head. Until the used topic has been silent for `ESTIMATOR_SILENCE`,
    the messages of every other topic are rejected.
    """

    def __init__(self) -> None:
        self._topic = ''  # of the newest accepted estimate
        self._accepted = -math.inf  # time of this estimate [s]
        self._rejections = Rejections()

    def require_sole(self, now: float, topic: str) -> None:
        """Raise an InputError with reason ``'publishers'`` while another topic is used."""
        if topic == self._topic or now - self._accepted > ESTIMATOR_SILENCE:
            return
        error = InputError(
            'publishers',
            f'estimates arrive on 2 topics ({self._topic}, {topic}), above the limit 1',
        )
        self._rejections.add(now, error)
        raise error

    def accept(self, now: float, topic: str) -> None:
        """Record that an estimate of a topic was used at a time [s]."""
        if topic != self._topic:
            self._rejections.clear()
        self._topic = topic
        self._accepted = now

    def fault(self, now: float) -> str:
        """Return which topics receive estimates at a time [s], if there are two; else ``''``."""
        return self._rejections.message(now)
