"""How far the gondola sways while the head presses; where it is too far, the force is reduced."""

from __future__ import annotations

import math

from facade_manipulator.compensation.impedance import ImpedanceSettings
from facade_manipulator.kinematics import MotionState, Pose, ZERO_STATE

ENVELOPE_TIME = 10.0  # s, in which the envelopes of the sway decay
LEAST_SHARE = 0.1  # of the force, that the guard leaves


class SwayWatch:
    """
    Watch the gondola.

    Attributes
    ----------
    envelope : Pose
        How far it has swayed lately along the wall [m], towards it [m] and in yaw [rad].
    push_back : float
        By how much it is further off the wall than before the touch [m].
    swing : MotionState
        Its motion about its mean distance of the wall.

    """

    def __init__(self) -> None:
        self.envelope = Pose(0.0, 0.0, 0.0)
        self.push_back = 0.0
        self.swing = ZERO_STATE
        self._distance = self._distance_before = 0.0

    def note(self, interval: float, rail: MotionState, in_contact: bool) -> None:
        """Note the disturbance an interval [s] after the one before."""
        decay = math.exp(-interval / ENVELOPE_TIME)
        place = rail.position
        self._distance += (1.0 - decay) * (place.y - self._distance)
        self.swing = MotionState(place._replace(y=place.y - self._distance), rail.velocity)
        self.envelope = Pose(*(
            max(abs(now), decay * before)
            for now, before in zip(self.swing.position, self.envelope, strict=True)))
        if not in_contact:
            self._distance_before = self._distance
        self.push_back = self._distance_before - self._distance

    def share(self, press: ImpedanceSettings) -> float:
        """Return the share of the force that the sway allows: falls where it grows too far."""
        return min(max(2.0 - self._ratio(press), LEAST_SHARE), 1.0)

    def obstacle(self, press: ImpedanceSettings, times: float) -> str:
        """Return which sway is above so many times its bound, empty if none is."""
        yaw, most_yaw = self.envelope.theta, times * press.most_yaw
        if yaw > most_yaw:
            return (f'the gondola yaws by {math.degrees(yaw):.1f} deg, bound '
                    f'{math.degrees(most_yaw):.1f} deg')
        x, most_x = self.envelope.x, times * press.most_sway
        if x > most_x:
            return (f'the gondola sways along the wall by {1e3 * x:.0f} mm, bound '
                    f'{1e3 * most_x:.0f} mm')
        return ''

    def _ratio(self, press: ImpedanceSettings) -> float:
        """Return the sway as a multiple of its bound, that of the axis where it is greater."""
        return max(self.envelope.theta / press.most_yaw, self.envelope.x / press.most_sway)
