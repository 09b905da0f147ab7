"""What the page shows of a gondola, as data for JSON: overview of the monitor, picture, traces."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
import math
from pathlib import Path
from typing import Any

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.interfaces import CORRECTED_POSE, END_EFFECTOR_POSE, GOAL_STATUS
from facade_manipulator.kinematics import compose, Geometry, invert, joints, Pose
from facade_manipulator.messages import CARRIAGES
from facade_manipulator.nodes.overview import of_one, OPERATION, Seen

PERIOD, SPAN = 0.1, 60.0  # s between views, and of the traces
FRESH = 3.0 * PERIOD  # s: what is older makes a gap in a trace
MOST_GONDOLAS = 8  # in full
MOST_FILES = 20
WALL_HALF_WIDTH = 2000.0  # mm: beyond what any rail sees


class View:
    """What the page shows of one gondola; every call of `look` is a row of its traces."""

    def __init__(self, seen: Seen, geometry: Geometry, wall_distance: float) -> None:
        self._seen, self._geometry, self._wall = seen, geometry, 1e3 * wall_distance
        self._rows: deque[list[float | None]] = deque(maxlen=round(SPAN / PERIOD))

    @property
    def past(self) -> list[list[float | None]]:
        """Return the rows of the last minute; who has just come begins with them."""
        return [*self._rows]

    def look(self, now: float) -> dict[str, Any]:
        """Return what is to be seen at a time [s, monotonic]; old values are not."""
        self._rows.append(_row(self._seen, now))
        return {'name': self._seen.namespace or '/', 'row': self._rows[-1],
                'picture': self._picture(now), **vars(of_one(self._seen, now))}

    def _picture(self, now: float) -> dict[str, Any]:
        """Return points and lines in frame `rail` [mm], without those that are not known."""
        geometry, half = self._geometry, 0.5 * max(0.02, self._geometry.carriage_length)
        picture: dict[str, Any] = {
            'rail': [1e3 * q for q in geometry.stroke], 'carriage': 1e3 * half,
            'reach': max(1e3 * geometry.link_length, self._wall) + 100.0}
        head = self._seen.pose(END_EFFECTOR_POSE, now)
        if head is not None:
            with suppress(ManipulatorError):  # no pose of this mechanism
                picture['joints'] = {name: _millimetres(*point) for name, point in
                                     joints(geometry, head)._asdict().items()}
        target = self._seen.pose(CORRECTED_POSE, now)
        if target is not None:
            picture['target'] = _millimetres(target.x, target.y)
            _, goal = self._seen.poses.get(GOAL_STATUS, (now, None))
            if goal is not None:
                picture['wall'] = wall_line(target, goal, self._wall)
        return picture


def wall_line(target: Pose, goal: Pose, distance: float) -> list[list[float]]:
    """Return both ends of the wall on the rail [mm], by a goal on it and where the rail has it."""
    x, y, theta = compose(target, invert(goal))
    return [[round(1e3 * x + math.cos(theta) * along - math.sin(theta) * distance, 1),
             round(1e3 * y + math.sin(theta) * along + math.cos(theta) * distance, 1)]
            for along in (-WALL_HALF_WIDTH, WALL_HALF_WIDTH)]


def _row(seen: Seen, now: float) -> list[float | None]:
    """Return time [s], distance of the head from the corrected goal [mm], forces [N]."""
    head, target = (seen.pose(topic, now, FRESH) for topic in (
        END_EFFECTOR_POSE, CORRECTED_POSE))
    distance = None if head is None or target is None else round(
        1e3 * math.hypot(head.x - target.x, head.y - target.y), 3)
    forces = seen.carriages(now, FRESH)[2]
    return [round(now, 2), distance, *(
        round(forces[name], 2) if name in forces else None for name in CARRIAGES)]


def _millimetres(*lengths: float) -> list[float]:
    return [round(1e3 * one, 1) for one in lengths]


def gondolas(
    known: Mapping[str, Mapping[str, Any]], asked: Sequence[str], shown: Sequence[str],
) -> tuple[list[str], int]:
    """
    Return the namespaces to show in full, and how many more there are.

    Who is shown stays, silent or not: each costs subscriptions, and names may come without end.
    """
    found = asked or [*shown, *(name for name, components in known.items()
                                if OPERATION in components and name not in shown)]
    return sorted(found[:MOST_GONDOLAS]), max(0, len(found) - MOST_GONDOLAS)


def recordings(folder: Path) -> dict[str, Path]:
    """Return the newest files of the black box by their names: those alone may be taken."""
    found = [path for path in folder.glob('blackbox_*.mcap')
             if path.is_file() and not path.is_symlink()]
    return {path.name: path for path in sorted(found, reverse=True)[:MOST_FILES]}
