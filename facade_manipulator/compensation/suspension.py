"""How the gondola hangs and sways, and what a press and its strokes do to it in the end."""

from __future__ import annotations

from collections import deque
import math
from typing import NamedTuple

from facade_manipulator.compensation.impedance import ImpedanceSettings
from facade_manipulator.kinematics import Geometry, GRAVITY, Pose
from facade_manipulator.motion.limits import Triple
from facade_manipulator.parameters import parameter, settings

FRICTION = 0.3  # of a brush on the wall
DAMPING_RATIO = 0.02  # usual of a gondola on cables
HARMONICS = (1, 3, 5, 7)
TOLERANCES = tuple(1.0 + 0.01 * percent for percent in range(-5, 6))  # of the periods
LEAST_AMPLITUDE = 0.01  # m, of strokes
STROKE_TOLERANCE = 0.1  # of length and time, by which one stroke may differ from the next
PERIOD_STEP = 0.5  # s, between the periods of strokes that are tried
ENVELOPE_TIME = 10.0  # s, in which the envelopes of the sway decay
LEAST_SHARE = 0.1  # of the force, that the guard leaves


@settings
class SuspensionSettings:
    """
    How the gondola hangs: on two cables, held at the wall by a guide.

    Each axis counts as a pendulum of its own, the body hanging straight below its cables.
    """

    mass: float = parameter(
        'Mass of the gondola; 0 if it is not known, then no press is checked', default=0.0,
        unit='kg', minimum=0.0, maximum=1e5)
    cable_length: float = parameter(
        'Free length of the cables', default=30.0, unit='m', minimum=1.0, maximum=500.0)
    cable_distance: float = parameter(
        'Distance of the two cables', default=1.2, unit='m', minimum=0.1, maximum=20.0)
    guide_stiffness: float = parameter(
        'Stiffness of the guide that keeps the gondola at the wall', default=0.0, unit='N/m',
        minimum=0.0, maximum=1e6)
    guide_lever: float = parameter(
        'Distance of either end of the guide from the middle; 0 for one guide there', default=0.0,
        unit='m', minimum=0.0, maximum=10.0)
    yaw_radius: float = parameter(
        'Radius of gyration about the vertical axis', default=0.7, unit='m', minimum=0.05,
        maximum=10.0)

    @property
    def stiffness(self) -> Triple:
        """With what it turns back in x, y and yaw [N/m, N/m, N m/rad]."""
        cables = self.mass * GRAVITY / self.cable_length
        return (cables, cables + self.guide_stiffness,
                cables * (0.5 * self.cable_distance) ** 2
                + self.guide_stiffness * self.guide_lever ** 2)

    @property
    def inertia(self) -> Triple:
        """What it has to move in x, y and yaw [kg, kg, kg m²]."""
        return self.mass, self.mass, self.mass * self.yaw_radius ** 2

    @property
    def periods(self) -> Triple:
        """Periods of x, y and yaw [s]."""
        x, y, yaw = (
            math.tau * math.sqrt(m / k) for m, k in zip(self.inertia, self.stiffness, strict=True))
        return x, y, yaw

    def swing(self, force: float, amplitude: float, period: float) -> tuple[float, float]:
        """
        Return how far strokes swing the gondola in the end along the wall [m] and in yaw [rad].

        Friction along the wall is a square wave, the place of the force nearly one: their odd
        harmonics excite the pendulums, which take the worst period within 5 %.

        The force is that on the wall [N]; half the length of the strokes is the amplitude [m], to
        and fro the period [s].
        """
        periods, (along, _, turning) = self.periods, self.stiffness
        x = FRICTION * force / along * _harmonics(periods[0] / period)
        return x, force * (amplitude + x) / turning * _harmonics(periods[2] / period)

    def push_back(self, force: float) -> float:
        """Return how far a force [N] pushes the gondola off the wall [m]."""
        return force / self.stiffness[1]

    def yaw(self, force: float, x: float) -> float:
        """Return how far a force [N] at a place x [m] along the rail turns the gondola [rad]."""
        return force * abs(x) / self.stiffness[2]


def _harmonics(ratio: float) -> float:
    """Return how far a square wave moves a pendulum whose period is that many of the wave's."""
    return max(sum(
        4.0 / (math.pi * n) / abs(1.0 - (n * r) ** 2 + 2j * DAMPING_RATIO * n * r)
        for n in HARMONICS) for r in (ratio * tolerance for tolerance in TOLERANCES))


class Strokes(NamedTuple):
    """Half their length [m], and the time to and fro [s]."""

    amplitude: float
    period: float


class StrokeWatch:
    """Recognise strokes."""

    def __init__(self) -> None:
        #: the present ones, None where the goals do not go to and fro
        self.strokes: Strokes | None = None
        self._goals: deque[tuple[float, float]] = deque(maxlen=3)

    def note(self, now: float, goal: Pose) -> None:
        """Note another goal, from a time [s] on."""
        self._goals.append((now, goal.x))
        self.strokes = None
        if len(self._goals) < 3:
            return
        (begin, first), (turn, other), (end, last) = self._goals
        length, period = abs(other - first), end - begin
        if (length >= 2.0 * LEAST_AMPLITUDE and abs(last - first) <= STROKE_TOLERANCE * length
                and abs(2.0 * turn - begin - end) <= STROKE_TOLERANCE * period):
            self.strokes = Strokes(0.5 * length, period)


def obstacle(
    suspension: SuspensionSettings, press: ImpedanceSettings, geometry: Geometry, goal: Pose
) -> str:
    """Return why the desired force cannot be had at a goal on the wall, empty if it can."""
    if not press.enabled or suspension.mass == 0.0:
        return ''
    force, length = press.force, suspension.cable_length
    yaw, back = suspension.yaw(force, goal.x), suspension.push_back(force)
    if yaw > press.most_yaw:
        return (f'{force:g} N at {abs(goal.x):g} m on {length:g} m of free cable turns the '
                f'gondola by {math.degrees(yaw):.0f} deg, bound '
                f'{math.degrees(press.most_yaw):.0f} deg')
    if goal.y + back > geometry.link_length:
        return (f'{force:g} N on {length:g} m of free cable push the gondola back by '
                f'{1e3 * back:.0f} mm: the goal is then {goal.y + back:.3f} m away, reach '
                f'{geometry.link_length:g} m')
    return ''


def stroke_obstacle(
    suspension: SuspensionSettings, press: ImpedanceSettings, strokes: Strokes | None
) -> str:
    """Return why strokes swing the gondola too far and which would not, empty if they do not."""
    if strokes is None or not press.enabled or suspension.mass == 0.0 or _is_calm(
            suspension, press, strokes):
        return ''
    (amplitude, period), periods = strokes, suspension.periods
    x, yaw = suspension.swing(press.force, amplitude, period)
    tried = sorted(
        (PERIOD_STEP * k for k in range(2, 1 + round(2.0 * period / PERIOD_STEP))),
        key=lambda other: abs(other - period))
    calm = next((other for other in tried if _is_calm(
        suspension, press, strokes._replace(period=other))), None)
    return (f'strokes of +-{amplitude:g} m, {period:.1f} s to and fro, may swing the gondola by '
            f'{1e3 * x:.0f} mm and {math.degrees(yaw):.1f} deg, bounds '
            f'{1e3 * press.most_sway:.0f} mm and {math.degrees(press.most_yaw):.1f} deg: its '
            f'periods are {periods[0]:.1f} s along the wall and {periods[2]:.1f} s in yaw; '
            + (f'{calm:g} s to and fro would not' if calm else 'press with less force'))


def _is_calm(
    suspension: SuspensionSettings, press: ImpedanceSettings, strokes: Strokes
) -> bool:
    x, yaw = suspension.swing(press.force, *strokes)
    return x <= press.most_sway and yaw <= press.most_yaw


class SwayWatch:
    """Watch how far the gondola sways while the head presses."""

    def __init__(self) -> None:
        #: how far it has swayed lately along the wall [m], towards it [m] and in yaw [rad]
        self.envelope = Pose(0.0, 0.0, 0.0)
        self.push_back = 0.0  #: by how much it is further off the wall than before the touch [m]
        self._distance = self._distance_before = 0.0

    def note(self, interval: float, rail: Pose, in_contact: bool) -> None:
        """Note the disturbance an interval [s] after the one before."""
        decay = math.exp(-interval / ENVELOPE_TIME)
        self._distance += (1.0 - decay) * (rail.y - self._distance)
        swing = rail._replace(y=rail.y - self._distance)
        self.envelope = Pose(*(
            max(abs(now), decay * before)
            for now, before in zip(swing, self.envelope, strict=True)))
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
