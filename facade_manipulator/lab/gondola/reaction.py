"""
The gondola and the head on the wall as one system: each feels the other.

What moves the gondola without the head (wind, a recording, prescribed sines) is a function of
time. What the wall does to the head moves the gondola's modes on top of that; their equations are
linear, so the two add up (but for the cables' pull in vertical gusts, which is left out here).
"""

from __future__ import annotations

from collections.abc import Callable
import math

import numpy as np

from facade_manipulator import kinematics
from facade_manipulator.kinematics import Carriages, Mechanism, Pose, Twist, Wrench, ZERO_POSE
from facade_manipulator.lab.gondola.facade import Facade, NO_CONTACT
from facade_manipulator.lab.gondola.gondola import GondolaSettings, modes
from facade_manipulator.lab.gondola.motion import Motion
from facade_manipulator.motion.timed_buffer import TimedBuffer

LONGEST_STEP = 0.002  # s, ten steps and more in a period of 500 kg on 100 N/mm
LONGEST_GAP = 0.5  # s, after which nobody knows where the head has been


class ModalReaction:
    """What a wrench on the rail adds to the gondola's motion."""

    def __init__(self, settings: GondolaSettings) -> None:
        self._modes = modes(settings)
        self._positions = np.zeros(len(self._modes.frequencies))
        self._velocities = np.zeros(len(self._modes.frequencies))

    @property
    def pose(self) -> Pose:
        """What it adds to the rail's pose."""
        return self.after(0.0)

    def after(self, time: float) -> Pose:
        """Return what it will have added after a time [s], if nothing slows it down."""
        return Pose(*(self._modes.output @ (self._positions + time * self._velocities)).tolist())

    @property
    def velocity(self) -> Twist:
        """What it adds to the rail's velocity."""
        return Twist(*(self._modes.output @ self._velocities).tolist())

    @property
    def energy(self) -> float:
        """Energy of the modes, potential and kinetic [J]."""
        swing = self._modes.frequencies * self._positions
        return 0.5 * float(swing @ swing + self._velocities @ self._velocities)

    def stepper(self, step: float) -> Callable[[Wrench], None]:
        """Return what moves the modes on by a step [s] under a wrench on the rail."""
        advance = self._modes.discrete(step)

        def move(wrench: Wrench) -> None:
            self._positions, self._velocities = advance(
                self._positions, self._velocities, np.array(wrench) @ self._modes.output)

        return move


class PressedGondola:
    """The rail's motion with the head on the wall; the given one is that without it."""

    def __init__(self, motion: Motion, facade: Facade, settings: GondolaSettings) -> None:
        self.wrench = NO_CONTACT  #: of the wall on the head, in its frame, at the last step
        self.reaction = ModalReaction(settings)
        self._motion = motion
        self._facade = facade
        self._feels = settings.reaction
        self._time = -math.inf
        self._rail = self._head = ZERO_POSE  # without the reaction; the head as the rail sees it
        self._place: Pose | None = None
        self._past: TimedBuffer[Pose] = TimedBuffer()

    def at(self, time: float) -> Pose:
        """Return the pose of the rail in the façade's frame at a time [s], the past included."""
        return kinematics.add(self._motion(time), self._added(time))

    def advance(self, time: float, head: Pose) -> Wrench:
        """
        Move on to a time [s] at which the head is at a pose of the rail's frame.

        Returns the wrench of the wall on the head then, in its frame. A time that is not later
        changes nothing.
        """
        if time <= self._time or not self._facade.settings.present:
            return self.wrench
        elapsed, rail = time - self._time, self._motion(time)
        if elapsed > LONGEST_GAP:
            self._coast(elapsed)
        else:
            self._press(elapsed, rail, head)
        self._time, self._rail, self._head = time, rail, head
        self._past.append(time, self.reaction.pose)
        return self.wrench

    def _coast(self, elapsed: float) -> None:
        """Swing freely: the head was not seen, or is seen for the first time."""
        self.wrench, self._place = NO_CONTACT, None
        if math.isfinite(elapsed):
            self.reaction.stepper(elapsed)(NO_CONTACT)

    def _press(self, elapsed: float, rail: Pose, head: Pose) -> None:
        """Step through the contact, the wrench taken in the middle of each step."""
        count = math.ceil(elapsed / LONGEST_STEP)
        step = elapsed / count
        move = self.reaction.stepper(step)
        for k in range(count):
            share = (k + 0.5) / count
            free = _between(self._rail, rail, share)
            place = kinematics.compose(
                kinematics.add(free, self.reaction.after(0.5 * step)),
                _between(self._head, head, share))
            last = place if self._place is None else self._place
            velocity = Twist(*(change / step for change in kinematics.subtract(place, last)))
            self._place = place
            self.wrench = self._facade.contact(place, velocity)
            if self._feels:
                here = kinematics.add(free, self.reaction.pose)
                move(_on_the_rail(here, place, self.wrench))

    def _added(self, time: float) -> Pose:
        """Return what the reaction has added at a time [s], the last of it later."""
        before, after = self._past.around(time)
        if before is None or after is None:
            return (before or after or (time, ZERO_POSE))[1]
        (begin, first), (end, second) = before, after
        return _between(first, second, (time - begin) / (end - begin))


def _between(first: Pose, second: Pose, share: float) -> Pose:
    return Pose(*(a + share * (b - a) for a, b in zip(first, second, strict=True)))


def _on_the_rail(rail: Pose, head: Pose, wrench: Wrench) -> Wrench:
    """Return a wrench on the head, in its frame, as one on the rail in the façade's frame."""
    fx, fy = _turned(head.theta, wrench)
    return Wrench(fx, fy, wrench.mz + (head.x - rail.x) * fy - (head.y - rail.y) * fx)


def carriage_loads(mechanism: Mechanism, head: Pose, wrench: Wrench) -> Carriages:
    """
    Return the forces along the rail with which the wall pulls at the carriages, J⁻ᵀ F [N].

    The head is in frame rail, the wrench of the wall in that of the head. Raises a LimitError as
    `carriage_forces`.
    """
    along_rail = Wrench(*_turned(head.theta, wrench), wrench.mz)
    return kinematics.carriage_forces(mechanism, head, along_rail)


def _turned(angle: float, wrench: Wrench) -> tuple[float, float]:
    """Return the force of a wrench in a frame that is turned back by an angle."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return cosine * wrench.fx - sine * wrench.fy, sine * wrench.fx + cosine * wrench.fy
