"""Go to each pose of a plan and have the head measured there, until it is known well enough."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
import re
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
import rclpy
from rclpy.signals import SignalHandlerOptions

from facade_manipulator import interfaces
from facade_manipulator.errors import CalibrationError
from facade_manipulator.interfaces import Topic
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import carriages_from, planar_pose
from facade_manipulator.ros.client import ManipulatorClient
from facade_manipulator.ros.interfaces import subscription
from facade_manipulator.tools.calibration import geometry_fit
from facade_manipulator.tools.calibration.plan_file import fill, goals, read_measured
from facade_manipulator.tools.calibration.target import Sought, Target
from facade_manipulator.tools.calibration.unknowns import in_units
from facade_manipulator.tools.commissioning.operator import Operator

SIDE = 0.003  # m: ten times the play of a worn screw, and within `design.MARGIN` of the stroke
READINGS, TIMEOUT = 20, 30.0  # messages that are averaged, s for them

Check = Callable[[np.ndarray], None]  # raises a CalibrationError for numbers that cannot be
Instrument = Callable[[int, Check], np.ndarray | None]  # of a row; None leaves it out


def run(
    path: Path, sought: Sought, enough: np.ndarray, namespace: str, topic: str | None,
    operator: Operator,
) -> None:
    """Measure with the nodes of a namespace, from a topic or by somebody who types."""
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)  # Ctrl-C is Python's
    try:
        with ManipulatorClient(namespace, 'calibrate') as client:
            instrument = (published(client, topic, sought.target) if topic else
                          typed(sought.target, operator))
            Survey(path, sought, enough, client, operator).measure(instrument)
    finally:
        rclpy.try_shutdown()


class Survey:
    """
    A plan that is filled in until the head is known to `enough`, shape (3,) [m, m, rad].

    The client is that of a driver that is active and of an ik_service, without a compensator.
    """

    def __init__(
        self, path: Path, sought: Sought, enough: np.ndarray, client: ManipulatorClient,
        operator: Operator,
    ) -> None:
        self._path, self._sought, self._enough = path, sought, enough
        self._client, self._operator, self._say = client, operator, operator.say
        self._goals = goals(path, sought.target.columns)
        self._carriages = listener(client, interfaces.JOINT_STATES, lambda states: carriages_from(
            states.name, states.position, 'joint_states'))
        self._left_out: set[int] = set()

    def measure(self, instrument: Instrument) -> None:
        """Measure one row after the other; what was measured stays, whatever happens."""
        status = self._client.wait_until(
            lambda: self._client.goal_status, 'ik_service/status', TIMEOUT)
        if status.level != DiagnosticStatus.OK:
            raise CalibrationError(status.message)
        self._operator.agree('The head goes to the poses of the plan by itself. Keep clear, and '
                             'keep the emergency stop in your hand.')
        try:
            while (row := self._next_row()) is not None:
                self._measure_row(row, instrument)
        finally:
            done = np.isfinite(read_measured(self._path, self._sought).heads).any(axis=1)
            self._say(f'{done.sum()} of {len(done)} rows are measured and saved in {self._path}')

    def _next_row(self) -> int | None:
        """Return which row is next; once the head is known well enough, only the last."""
        seen, sought = read_measured(self._path, self._sought), self._sought
        is_open, is_enough = np.isnan(seen.heads).all(axis=1), False
        try:
            found = geometry_fit.identify(
                sought.machine(*seen), sought.unknowns, seen, sought.noise)
            known = geometry_fit.known_to(found, seen)
            is_enough = not found.kept and bool((known <= self._enough).all())
            self._say(f'the head is known to {in_units(known)}; wanted: {in_units(self._enough)}')
        except CalibrationError as error:
            self._say(f'so far: {error}')
        rows = [len(is_open) - 1] if is_enough else range(len(is_open))
        return next((row for row in rows if is_open[row] and row not in self._left_out), None)

    def _measure_row(self, row: int, instrument: Instrument) -> None:
        goal, direction = self._goals[row]
        self._arrive(goal, direction)
        station = np.append(self._carriages().mean(axis=0), direction)
        numbers = instrument(row + 1, partial(self._check, row, station))
        moved = np.abs(self._carriages().mean(axis=0) - station[:3]).max()
        bound = self._sought.number_noise.position
        if numbers is None:
            self._left_out.add(row)
        elif moved > bound:
            self._say(f'row {row + 1} is not written, a carriage moved meanwhile: by '
                      f'{1e3 * moved:.3g} mm, above the noise of {1e3 * bound:.3g} mm')
        else:
            fill(self._path, row, station, self._sought.target.columns, numbers)

    def _arrive(self, goal: Pose, direction: float) -> None:
        """Stand at a pose of the head, arrived at so that the carriages rest on one flank."""
        try:
            for pose in (goal._replace(x=goal.x - direction * SIDE), goal):
                self._client.stand_at(pose)
        except KeyboardInterrupt:
            self._say(self._client.halt())
            raise

    def _check(self, row: int, station: np.ndarray, numbers: np.ndarray) -> None:
        seen, sought = read_measured(self._path, self._sought), self._sought
        machine = sought.machine(*seen)
        seen.carriages[row] = station
        seen.heads[row] = sought.target.pose(numbers, sought.number_noise)
        if machine is sought.geometry:
            machine = sought.machine(*seen)  # the first row shows itself where the frame is
        geometry_fit.require_explained(machine, seen)


def listener(
    client: ManipulatorClient, topic: Topic, read: Callable[[Any], Any], name: str = ''
) -> Callable[[], np.ndarray]:
    """Return what waits for the next messages of a topic and returns what they say, a row each."""
    messages: list[Any] = []
    subscription(client.node, topic, messages.append, name=name)

    def listen() -> np.ndarray:
        messages.clear()
        client.wait_until(lambda: len(messages) >= READINGS,
                          f'{READINGS} messages on {name or topic.name}', TIMEOUT)
        return np.array([read(one) for one in messages])

    return listen


def published(client: ManipulatorClient, topic: str, target: Target) -> Instrument:
    """Return an instrument that publishes poses; of each row it is the median of some."""
    listen = listener(
        client, interfaces.HEAD_ON_WALL, lambda one: planar_pose(one.pose, topic), topic)

    def read(row: int, check: Check) -> np.ndarray:
        numbers = np.median(np.unwrap(listen(), axis=0), axis=0)[target.axes]
        check(numbers)
        return numbers

    return read


def typed(target: Target, operator: Operator) -> Instrument:
    """
    Return an instrument that somebody reads and types.

    Between numbers are blanks, or commas with a blank; a decimal comma is a point.
    """
    units = [factor for _, factor in target.units]
    wanted = ', '.join(
        f'{name} [{unit}]' for name, (unit, _) in zip(target.columns, target.units, strict=True))

    def read(row: int, check: Check) -> np.ndarray | None:
        while text := operator.ask(f'row {row}: {wanted}; Enter leaves it out:', '--topic'):
            words = re.split(r'[;\s]+|,\s+', text)
            try:
                numbers = np.array([float(word.replace(',', '.')) / unit for word, unit in zip(
                    words, units, strict=True)])
                check(numbers)
                return numbers
            except CalibrationError as error:
                operator.say(f'{error}. Type it again.')
            except ValueError:
                operator.say(f'{text} is not {wanted}. Type it again.')
        return None

    return read
