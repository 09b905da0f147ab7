"""
What a person sees of a gondola, as data without ROS and colours: for a terminal and for a panel.

Everything comes in with the monotonic time of its receipt [s]: the clock of another computer makes
nothing old or new.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
import math
from typing import Any

from facade_manipulator import diagnostics, interfaces
from facade_manipulator.diagnostics import REJECTED, Report
from facade_manipulator.errors import InputError
from facade_manipulator.interfaces import Topic
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import CARRIAGES, carriages_from, status_level, status_values

# s without diagnostics of a component, which come once a second: a person sees it within 2 s
SILENT_AFTER = 1.8
OLD_AFTER = 1.0  # s after which a pose is no longer shown
OPERATION, RECORDER = str(diagnostics.OPERATION), str(diagnostics.BLACK_BOX)
LEVEL_WORDS = {'ok': '', 'warn': 'warning: ', 'error': 'ERROR: ', 'stale': 'stale: '}
POSES = {
    interfaces.GOAL_STATUS: 'goal on the wall',
    interfaces.CORRECTED_POSE: 'corrected goal',
    interfaces.END_EFFECTOR_POSE: 'head, from the rail',
    interfaces.UNCOMPENSATED_ERROR: 'disturbance at the goal',
    interfaces.WALL_ERROR: 'from the goal',
}
# what is shown of a component beside its message: diagnostic key, and how it is written
DETAILS = {str(component): {component.key(key): text for key, text in shown.items()}
           for component, shown in (
    (diagnostics.OPERATION, {
        'drive faults': 'faults: {}', REJECTED: '{} setpoints rejected',
        'version': 'version {}', 'parameters': 'parameters {}'}),
    (diagnostics.BUS, {
        'cycles': '{} cycles', 'missed cycles': '{} missed',
        'worst lateness [ms]': '≤ {} ms late', 'worst-case load [%]': '{} % load'}),
    (diagnostics.CORRECTION, {
        REJECTED: '{} rejected', 'age of the estimate [ms]': 'estimate {} ms old',
        'saturation error': 'saturation {}',
        'standard deviation of the prediction': 'expected error {}'}),
    (diagnostics.GOAL, {'setpoints': '{} setpoints', REJECTED: '{} goals rejected'}),
    (diagnostics.BLACK_BOX, {'kept [s]': '{} s kept', 'files written': '{} files written'}))}
OTHER_DETAILS = {REJECTED: '{} rejected'}
TROUBLES = {diagnostics.OPERATION.key(key): before for key, before in (
    ('cause', 'cause: '), ('further causes', 'further causes: '), ('next step', 'next: '))}
STATE = diagnostics.OPERATION.key('state')
LAG = diagnostics.AXIS.key('following error [m]')
MISSING = {
    OPERATION: 'no diagnostics; next: start driver, or give its --namespace',
    RECORDER: 'no diagnostics: no stop is recorded; next: start recorder',
}


Components = Mapping[str, Report]


@dataclass
class Seen:
    """What came last; poses and joints with the time of their receipt [s]."""

    namespace: str = ''
    #: by namespace and name of the component
    gondolas: Mapping[str, Components] = field(default_factory=dict)
    poses: dict[Topic, tuple[float, Pose | None]] = field(default_factory=dict)
    joints: tuple[float, Any] = (-math.inf, None)  #: a JointState

    @property
    def components(self) -> Components:
        """Return those of the namespace itself."""
        return self.gondolas.get(self.namespace, {})

    def pose(self, topic: Topic, now: float, oldest: float = OLD_AFTER) -> Pose | None:
        """Return a pose that is not old."""
        received, pose = self.poses.get(topic, (-math.inf, None))
        return pose if now - received <= oldest else None

    def carriages(
        self, now: float, oldest: float = OLD_AFTER
    ) -> tuple[dict[str, float], ...]:
        """Return positions [mm], speeds [mm/s] and forces [N] by carriage: what is not old."""
        received, joints = self.joints
        if now - received > oldest:
            return {}, {}, {}
        return tuple(_of_carriages(joints.name, values, scale) for values, scale in (
            (joints.position, 1e3), (joints.velocity, 1e3), (joints.effort, 1.0)))


def _of_carriages(names: Sequence[str], values: Sequence[float], scale: float) -> dict[str, float]:
    try:
        known = carriages_from(names, values, 'joint state')
    except InputError:
        return {}  # ik_service rejects it, too, and says why
    return {name: scale * value for name, value in zip(CARRIAGES, known, strict=True)}


@dataclass(frozen=True)
class Words:
    """A text that says by itself how serious it is; the level, such as ``error``, colours it."""

    text: str
    level: str = 'ok'


@dataclass(frozen=True)
class Table:
    """Rows under heads; a ``>`` before a head: numbers, to the right."""

    heads: tuple[str, ...]
    rows: tuple[tuple[Words, ...], ...]
    narrow: int  #: how many columns a narrow screen has room for


@dataclass(frozen=True)
class Overview:
    """What is the matter, why, what to do next; then the figures."""

    title: Words
    troubles: tuple[Words, ...]
    tables: tuple[Table, ...]


def overview(seen: Seen, now: float) -> Overview:
    """Return what is to be seen of a gondola; of all that there are where none is named."""
    fleet = {name: components for name, components in sorted(seen.gondolas.items())
             if OPERATION in components}
    if not seen.namespace and fleet.keys() - {''}:
        return _fleet(fleet, now)
    return of_one(seen, now)


def of_one(seen: Seen, now: float) -> Overview:
    """Return what is to be seen of the gondola of the namespace, be it named or not."""
    components = seen.components
    state = _said(components, OPERATION, now, STATE)
    return Overview(
        Words(f'{seen.namespace or "/"}: {state.text}', state.level),
        tuple(_troubles(components, now)),
        (_pose_table(seen, now), _carriage_table(seen, now), _component_table(components, now)))


def _fleet(gondolas: Mapping[str, Components], now: float) -> Overview:
    rows = tuple(
        (Words(name or '/'), _said(components, OPERATION, now, STATE),
         Words('; '.join(words.text for words in _troubles(components, now))))
        for name, components in gondolas.items())
    return Overview(
        Words(f'{len(rows)} gondolas'),
        (Words('next: monitor --namespace NAME shows one of them in full'),),
        (Table(('gondola', 'state', 'why'), rows, 3),))


def _troubles(components: Components, now: float) -> Iterator[Words]:
    """Yield cause and next step of the driver, then what else is wrong, each in full."""
    operation = components.get(OPERATION)
    if operation is None or _silence(operation, now):
        yield _said(components, OPERATION, now)
    else:
        values, level = status_values(operation.status), status_level(operation.status)
        for key, before in TROUBLES.items():
            if values.get(key):
                yield Words(before + values[key], level)
        if level != 'ok' and not values.get('cause'):
            yield _said(components, OPERATION, now)
    for name in sorted({*components, *MISSING} - {OPERATION}):
        words = _said(components, name, now)
        if words.level != 'ok':
            yield Words(f'{name}: {words.text}', words.level)


def _brief(words: Words) -> Words:
    """Return how what is said begins: in full it stands above the tables."""
    return Words(words.text.partition(';')[0], words.level)


def _said(components: Components, name: str, now: float, key: str = '') -> Words:
    """Return a value or the message of a component, or that it says nothing yet or any more."""
    report = components.get(name)
    if report is None:
        return _words('warn' if name in MISSING else 'stale', MISSING.get(name, 'no diagnostics'))
    if silence := _silence(report, now):
        return _words('stale', silence)
    message = report.status.message
    return _words(status_level(report.status), status_values(report.status).get(key, message))


def _silence(report: Report, now: float) -> str:
    silence = now - report.received
    return f'silent for {silence:.0f} s; next: see its log' if silence > SILENT_AFTER else ''


def _words(level: str, text: str) -> Words:
    return Words(LEVEL_WORDS[level] + text, level)


def _pose_table(seen: Seen, now: float) -> Table:
    return _table(('pose', '>x [mm]', '>y [mm]', '>θ [°]'), (
        (title, f'{1e3 * pose.x:+.1f}', f'{1e3 * pose.y:+.1f}', f'{math.degrees(pose.theta):+.2f}')
        for topic, title in POSES.items() if (pose := seen.pose(topic, now)) is not None), 4)


def _carriage_table(seen: Seen, now: float) -> Table:
    return _table(
        ('carriage', 'drive', '>position [mm]', '>speed [mm/s]', '>force [N]', '>lag [mm]'),
        ((name, _brief(_said(seen.components, f'driver: {name}', now)), *_motion(seen, name, now),
          _lag(_values(seen.components, f'driver: {name}', now))) for name in CARRIAGES), 3)


def _values(components: Components, name: str, now: float) -> dict[str, str]:
    """Return the values of a component, none of one that is silent."""
    report = components.get(name)
    return {} if report is None or _silence(report, now) else status_values(report.status)


def _lag(values: dict[str, str]) -> str:
    lag = _number(values.get(LAG))
    return '-' if lag is None else f'{1e3 * lag:+.2f}'


def _motion(seen: Seen, name: str, now: float) -> tuple[str, ...]:
    columns = seen.carriages(now)
    return tuple(form.format(column[name]) if name in column else '-' for form, column in zip(
        ('{:+.2f}', '{:+.1f}', '{:+.1f}'), columns, strict=True))


def _component_table(components: Components, now: float) -> Table:
    names = dict.fromkeys((*DETAILS, *sorted(components)))
    return _table(('component', 'state', 'so far'), (
        (name, _brief(_said(components, name, now)),
         _details(name, _values(components, name, now)))
        for name in names if name in {*components, *MISSING}
        and name.removeprefix('driver: ') not in CARRIAGES), 2)


def _details(name: str, values: dict[str, str]) -> str:
    return ', '.join(text.format(_short(values[key]))
                     for key, text in DETAILS.get(name, OTHER_DETAILS).items()
                     if values.get(key, 'inf') != 'inf')


def _short(value: str) -> str:
    number = _number(value)
    if number is None or not math.isfinite(number) or number.is_integer():
        return value  # words, and the checksum 12e45678
    return f'{number:.3g}'


def _number(value: str | None) -> float | None:
    try:
        return float(value or '')
    except ValueError:
        return None


def _table(heads: tuple[str, ...], rows: Any, narrow: int) -> Table:
    return Table(heads, tuple(
        tuple(Words(cell) if isinstance(cell, str) else cell for cell in row) for row in rows),
        narrow)
