"""What nodes say of themselves: diagnostics, rejections counted, what the driver is doing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
import math
import platform
import time
from typing import Any, NamedTuple
import warnings

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from facade_manipulator import interfaces
from facade_manipulator.diagnostics import LAST_REJECTION, REJECTED, unknown_keys
from facade_manipulator.errors import InputError, LimitError, ManipulatorError, without_numbers
from facade_manipulator.interfaces import Topic
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import STATUS_LEVELS, status_values
from facade_manipulator.ros.clocks import steady_timer
from facade_manipulator.ros.conversions import node_time
from facade_manipulator.ros.interfaces import publisher

LEVELS = {word: bytes([number]) for number, word in enumerate(STATUS_LEVELS)}
GOAL_LEVELS = {'held back': 'warn', 'rejected': 'error', 'ended': 'warn'}
REJECTED_STAMP = 'rejected goal stamp'
FOLLOWED = {  # key of the goal that is followed, and its factor
    'followed x [mm]': 1e3, 'followed y [mm]': 1e3, 'followed angle [deg]': math.degrees(1.0)}
PERIOD = 1.0  # s, of /diagnostics
WARN_EVERY = 1.0  # s
STATUS_PERIOD = 0.5  # s, between two messages on driver/status that say the same
SILENCE = 4 * STATUS_PERIOD  # s: the driver is dead, or does not get through
HOST = platform.node()  # the hardware of what is no drive
REPEAT_AFTER = 60.0  # s, for a message that stands in the log already


def stamp_text(stamp: Time) -> str:
    """Return a stamp as a value of a diagnostic status, exact: seconds with nine decimals."""
    return f'{stamp.sec}.{stamp.nanosec:09d}'


def diagnostic_status(
    name: str, level: str, message: str, values: Mapping[str, Any], hardware_id: str = ''
) -> DiagnosticStatus:
    """Return one component's status; `level` is a key of `LEVELS`."""
    return DiagnosticStatus(
        name=name, level=LEVELS[level], message=message, hardware_id=hardware_id,
        values=[KeyValue(key=key, value=f'{value:.6g}' if isinstance(value, float) else str(value))
                for key, value in values.items()])


def rejection_status(name: str, error: ManipulatorError, goal_stamp: Time) -> DiagnosticStatus:
    """Return why a request with a goal is rejected: stamp of the goal, reason, limit."""
    values = {'goal stamp': stamp_text(goal_stamp), 'reason': getattr(error, 'reason', 'other')}
    if isinstance(error, LimitError):
        values.update(
            {key: getattr(error, key) for key in ('quantity', 'value', 'bound', 'unit')})
    return diagnostic_status(name, 'error', str(error), values)


class RejectedGoal(NamedTuple):
    """A goal that is not followed, and why."""

    stamp: Time
    reason: str


def goal_status(
    stamp: Time, progress: Any, reason: str, followed: Pose | None,
    rejected: RejectedGoal | None = None, pressing: Mapping[str, Any] | None = None,
) -> DiagnosticStatus:
    """
    Return what becomes of a goal.

    Parameters
    ----------
    stamp : builtin_interfaces.msg.Time
        Of the goal.
    progress : GoalProgress
        As the compensation has it.
    reason : str
        Why it is not reached, ``''`` if there is none.
    followed : Pose or None
        The goal that is followed meanwhile.
    rejected : RejectedGoal, optional
        The last one: whoever reads the newest message alone learns of it, too.
    pressing : mapping, optional
        What the head does on the wall.

    """
    state = progress.state.value
    values = {
        'goal stamp': stamp_text(stamp),
        'state': state,
        'distance [mm]': 1e3 * progress.distance,
        'angle [deg]': math.degrees(progress.angle),
        'time to go [s]': progress.time_to_go,
        'reason': reason,
        **(pressing or {}),
    }
    if followed is not None:
        values.update((key, scale * value) for (key, scale), value in zip(
            FOLLOWED.items(), followed, strict=True))
    if rejected is not None:
        values |= {REJECTED_STAMP: stamp_text(rejected.stamp), 'rejection': rejected.reason}
    message = f'{state}: {reason}' if reason else state
    return diagnostic_status('goal', GOAL_LEVELS.get(state, 'ok'), message, values)


class DiagnosticsPublisher:
    """
    Publish the status of a node's components on /diagnostics.

    Parameters
    ----------
    node : rclpy.node.Node
    components : callable
        Returns the list of `diagnostic_msgs.msg.DiagnosticStatus` of this moment, each named
        after its component alone: the node's name is put before it.

    """

    def __init__(self, node: Node, components: Callable[[], list[DiagnosticStatus]]) -> None:
        self._node = node
        self._name = node.get_fully_qualified_name().lstrip('/')
        self._components = components
        self._outcome: Any = None
        self._publisher = publisher(node, interfaces.DIAGNOSTICS)
        steady_timer(node, PERIOD, self.publish)

    def publish_news(self, outcome: Any) -> None:
        """Publish the present status at once if what it says in short differs from before."""
        if outcome != self._outcome:
            self._outcome = outcome
            self.publish()

    def publish(self) -> None:
        """Publish the present status."""
        message = DiagnosticArray(status=self._components())
        for item in message.status:
            _look_at(item)
            item.name = f'{self._name}: {item.name}'
            item.hardware_id = item.hardware_id or HOST
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)


def _look_at(status: DiagnosticStatus) -> None:
    """Warn of keys that are in no document; the tests make an error of that."""
    if unknown := unknown_keys(status.name, status_values(status)):
        warnings.warn(f'not in the table of diagnostics: {status.name}: {unknown}', stacklevel=2)


class RepeatedLog:
    """
    Log at most once a second, the same once a minute: whoever repeats fills no disk.

    Messages that differ in numbers alone are the same.
    """

    def __init__(self) -> None:
        self._logged: dict[str, float] = {}  # when, by message without its numbers

    def is_due(self, message: str) -> bool:
        """
        Return whether to log a message now.

        The caller logs it itself: rclpy takes but one severity from each line of code.
        """
        now, kind = time.monotonic(), without_numbers(message)
        self._logged = {
            one: at for one, at in self._logged.items() if now - at < REPEAT_AFTER}
        newest = max(self._logged.values(), default=-math.inf)
        if kind in self._logged or now - newest < WARN_EVERY:
            return False
        self._logged[kind] = now
        return True


class Rejections:
    """
    Count rejected messages by reason and log why, as often as `RepeatedLog` does.

    ``with rejections:`` adds the `ManipulatorError` that the block raises and goes on after it.
    """

    def __init__(self, node: Node) -> None:
        self._logger = node.get_logger()
        self._counts: Counter[str] = Counter()
        self.last_message = ''
        self._log = RepeatedLog()

    def __enter__(self) -> None:
        pass

    def __exit__(self, _: object, error: BaseException | None, __: object) -> bool:
        if not isinstance(error, ManipulatorError):
            return False
        self.add(error)
        return True

    @property
    def total(self) -> int:
        """Count of all rejections."""
        return self._counts.total()

    def add(self, error: ManipulatorError, what: str = '', is_logged: bool = True) -> None:
        """Count a rejection; `what` names the message where the error's message does not."""
        self._counts[getattr(error, 'reason', 'other')] += 1
        self.last_message = f'{what}: {error}' if what else str(error)
        if is_logged and self._log.is_due(self.last_message):
            self._logger.warning(self.last_message)

    def values(self) -> dict[str, int | str]:
        """Return the counters as key-value pairs of a diagnostic status."""
        counts = {f'{REJECTED}: {reason}': n for reason, n in sorted(self._counts.items())}
        return {REJECTED: self.total, **counts, LAST_REJECTION: self.last_message}


class DriverStatus(NamedTuple):
    """What the driver is doing."""

    state: str  #: such as ``'active'`` or ``'stopped'``
    activity: str  #: what the carriages are doing while it is active, such as ``'holding'``
    next_step: str  #: what the operator does so that goals are followed, ``''`` if they are
    #: since when the drives follow setpoints [s]; infinite while they do not
    active_since: float = math.inf
    power: str = 'unknown'  #: of the drives, as their statuswords say

    def __str__(self) -> str:
        return 'the driver is silent' if self is SILENT else f'the drives are {self.state}'

    def to_message(self, level: str, message: str) -> DiagnosticStatus:
        """Return the message on driver/status."""
        return diagnostic_status('operation', level, message, {
            'state': self.state, 'activity': self.activity, 'next step': self.next_step,
            'active since': str(self.active_since), 'power': self.power})

    @staticmethod
    def from_message(message: DiagnosticStatus) -> DriverStatus:
        """Return what a message on driver/status says; an InputError if no driver says that."""
        values = status_values(message)
        try:
            since = float(values['active since'])
            if not since > -math.inf:  # nor NaN
                raise ValueError(f'active since {since}')
            return DriverStatus(values['state'], values['activity'], values['next step'],
                                since, values.get('power', 'unknown'))
        except (KeyError, ValueError) as error:
            raise InputError(
                'names', f'driver/status is not as the driver sends it: {error}') from None


SILENT = DriverStatus('silent', 'unknown', 'look whether the driver still runs')


class DriverWatch:
    """
    Know what the driver is doing, and whether it says anything.

    Parameters
    ----------
    node : rclpy.node.Node
    rejections : Rejections
        Counts messages that no driver sends.
    on_change : callable
        Called after `status` has changed.
    subscribe : callable
        Subscribes to the topic, as `PublisherWatch.subscribe` does.

    Attributes
    ----------
    status : DriverStatus or None
        None before a driver has published it, `SILENT` once it publishes no more.

    """

    def __init__(
        self, node: Node, rejections: Rejections, on_change: Callable[[], None],
        subscribe: Callable[[Topic, Callable[[DiagnosticStatus], None]], Any],
    ) -> None:
        self.status: DriverStatus | None = None
        self._active_from = math.inf  # s, monotonic: the system's clock may be set meanwhile
        self._node = node
        self._rejections = rejections
        self._on_change = on_change
        subscribe(interfaces.DRIVER_STATUS, self._receive)
        self._silence = steady_timer(
            node, SILENCE, lambda: self._change(SILENT), autostart=False)

    @property
    def idle(self) -> DriverStatus | None:
        """Return the status of a driver that does not follow setpoints, else None."""
        status = self.status
        return None if status is None or math.isfinite(status.active_since) else status

    def may_move(self, came: float) -> bool:
        """Return whether a goal that came then [s, monotonic] came after the activation."""
        return self.status is None or came >= self._active_from

    def _receive(self, message: DiagnosticStatus) -> None:
        with self._rejections:
            self._change(DriverStatus.from_message(message))
            self._silence.reset()

    def _change(self, status: DriverStatus) -> None:
        if status == self.status:
            return
        if self.status is None or status.active_since != self.status.active_since:
            ago = max(node_time(self._node) - status.active_since, 0.0)
            self._active_from = (
                math.inf if math.isinf(status.active_since) else time.monotonic() - ago)
        self.status = status
        self._on_change()
