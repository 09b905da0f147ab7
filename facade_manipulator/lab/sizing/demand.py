"""
What a motion of the rail and the strokes on the wall ask of the three carriages.

The head stands still on the wall where the goal does, so its mass costs nothing there; the
carriages move with the rail and along it. All arrays are of even samples: rows of x, y, θ or of
q1, q2, q3. A link counts half to its carriage and half to the head.
"""

from __future__ import annotations

from collections.abc import Iterator
import math
from typing import NamedTuple

import numpy as np

from facade_manipulator import kinematics
from facade_manipulator.kinematics import Arrays, Geometry, Pose
from facade_manipulator.lab.gondola import Facade, MissionSettings, Motion, pushed, Scenario
from facade_manipulator.motion import HeadMotion, ReferencePath, ReferenceSettings
from facade_manipulator.parameters import parameter, settings

STEP = 0.01  # s, between samples: at 2 Hz second differences are 1 % too small
CLEARANCE = 0.014  # m, of reach and gap: where the workspace limit begins to bend y and θ
ROOM = 0.034  # m, at either end of the rail, where it begins to bend x


@settings
class Payload:
    """What the carriages move and what the head presses with."""

    wall_force: float = parameter(
        'Force of the head on the wall', default=0.0, unit='N', minimum=0.0, maximum=1e4)
    head_mass: float = parameter(
        'Mass of platform and tool', default=4.0, unit='kg', minimum=0.0, maximum=1e3)
    head_inertia: float = parameter(
        'Moment of inertia of platform and tool about the head', default=0.15, unit='kg m^2',
        minimum=0.0, maximum=1e3)
    carriage_mass: float = parameter(
        'Mass of a carriage', default=3.0, unit='kg', minimum=0.0, maximum=1e3)
    friction: float = parameter(
        'Friction of a carriage on rail and seals', default=10.0, unit='N', minimum=0.0,
        maximum=1e4)


class Task(NamedTuple):
    """Rail and head in the façade's frame, shape (n, 3) each, a `STEP` apart."""

    rail: np.ndarray
    head: np.ndarray
    wrench: np.ndarray | float = 0.0  #: of the head on the wall [N, N, N m], likewise


class Demand(NamedTuple):
    """Head in frame rail, and what each carriage does: rows of q1, q2, q3."""

    pose: np.ndarray
    position: np.ndarray  #: [m]
    speed: np.ndarray
    acceleration: np.ndarray
    force: np.ndarray  #: of the drive along the rail [N]
    stroke: tuple[float, float]  #: ends of the rail that it takes [m]

    @property
    def power(self) -> np.ndarray:
        """Mechanical power of each carriage [W]."""
        return self.force * self.speed


def task(motion: Motion, mission: MissionSettings) -> Task:
    """Sample a motion of the rail, and the path of the head through a mission's goals."""
    times = STEP * np.arange(round(mission.duration / STEP))
    path, goal = ReferencePath(ReferenceSettings()), mission.goal(0.0)
    path.initialise(0.0, HeadMotion(goal), goal)
    head = []
    for time in times.tolist():
        if mission.goal(time) != goal:
            goal = mission.goal(time)
            path.retarget(time, goal)
        head.append(path.at(time).position)
    return Task(np.array([motion(time) for time in times.tolist()]), np.array(head))


def tasks(scenario: Scenario, payload: Payload) -> Iterator[Task]:
    """
    Yield a scenario's strokes, at its wall where it has one, and the same under the force.

    The force is the scenario's own or the payload's, whichever is greater. It pushes the brush in
    and the gondola back, and with the friction of the strokes it swings the gondola, as far as the
    compensator lets it: beyond, it presses less.
    """
    free, wall = task(scenario.motion(), scenario.mission), Facade(scenario.facade)
    impedance = scenario.compensator.impedance
    force, depth = max(payload.wall_force, impedance.enabled * impedance.force), 0.0
    if wall.settings.present:
        free.head[:, 1] = [wall.distance(x) for x in free.head[:, 0].tolist()]
        depth = force / (wall.settings.brush_share * wall.settings.stiffness)
    yield free
    if force > 0.0:
        drag = wall.settings.friction * np.tanh(
            rates(free.head)[:, 0] / wall.settings.friction_speed)
        x, y, _ = (free.head - free.rail).T
        back = pushed(scenario.gondola, -force * np.column_stack(
            [drag, np.ones_like(drag), x - y * drag]), STEP)
        most = np.array((impedance.most_sway, math.inf, impedance.most_yaw))
        yield Task(
            free.rail + np.clip(back, -most, most), free.head + (0.0, depth, 0.0),
            force * np.column_stack([drag, np.ones_like(drag), np.zeros_like(drag)]))


def rates(values: np.ndarray) -> np.ndarray:
    """Return the derivatives of samples by time."""
    return np.gradient(values, STEP, axis=0, edge_order=2)


def _along_rail(of: Task, values: np.ndarray) -> np.ndarray:
    """Return what has x, y and θ along the façade's axes along those of the rail."""
    x, y, theta = values.T
    sine, cosine = np.sin(of.rail[:, 2]), np.cos(of.rail[:, 2])
    return np.column_stack([cosine * x + sine * y, cosine * y - sine * x, theta])


def demand(geometry: Geometry, of: Task, payload: Payload, offset: float = 0.0) -> Demand | None:
    """
    Return what the carriages do; None where the mechanism cannot, however long its rail is.

    It can with `CLEARANCE` of reach and carriage gap, before N = 0 and well conditioned; the rail
    stands farther from the wall by the offset [m].
    """
    pose = _along_rail(of, of.head - of.rail + (0.0, offset, 0.0))
    at = kinematics.link_arrays(geometry, pose[:, 1], pose[:, 2])
    if not reachable(geometry, at):
        return None
    # columns in one piece: all that follows takes each axis by itself
    position = np.asfortranarray(_positions(geometry, pose, at))
    speed = rates(position)
    acceleration = rates(speed)
    forces = head_forces(geometry, at, _wrench(of, payload)) + _carriage_forces(
        of, payload, position, speed, acceleration)
    return Demand(pose, position, speed, acceleration, forces, _stroke(of, position))


def _stroke(of: Task, position: np.ndarray) -> tuple[float, float]:
    """Return the ends of the rail that it takes whenever a goal comes: nothing is in step."""
    goals, sway = of.head[:, 0], of.rail[:, 0]
    across = position - (goals - sway)[:, None]
    return (float(goals.min() - sway.max() + across.min()) - ROOM,
            float(goals.max() - sway.min() + across.max()) + ROOM)


def reachable(geometry: Geometry, at: Arrays) -> bool:
    """Return whether the mechanism closes at all samples, with room to spare."""
    _, cosine, u1, u2, s1, s2 = at
    length, half = geometry.link_length, geometry.platform_half_length
    gap = half * cosine - np.maximum(s1, s2)
    with np.errstate(invalid='ignore'):
        index = kinematics.index_of(geometry, at, half / kinematics.CONDITIONING_RATIO)
        well = index > kinematics.MIN_CONDITIONING
    return bool(
        np.max(np.maximum(np.abs(u1), np.abs(u2))) < length - CLEARANCE
        and np.min(gap) > geometry.carriage_gap + CLEARANCE
        and np.min(kinematics.branch_number(at)) > 0.0 and well.all())


def head_forces(
    geometry: Geometry, at: Arrays, wrench: np.ndarray
) -> np.ndarray:
    """Return the carriage forces J⁻ᵀ F with which the head exerts wrenches, shape (n, 3)."""
    sine, cosine, u1, u2, s1, s2 = at
    half = geometry.platform_half_length
    y1, y2 = -u1 / s1, u2 / s2
    t1 = half * (u1 * cosine + s1 * sine) / s1
    t2 = half * (u2 * cosine - s2 * sine) / s2
    determinant = y1 * t2 - y2 * t1
    fx, fy, mz = wrench.T
    first = (fy * t2 - mz * y2) / determinant
    second = (mz * y1 - fy * t1) / determinant
    return np.column_stack([first, second, fx - first - second])


def _positions(
    geometry: Geometry, pose: np.ndarray, at: Arrays
) -> np.ndarray:
    _, cosine, _, _, s1, s2 = at
    x, span = pose[:, 0], geometry.platform_half_length * cosine
    return np.column_stack([x - span + s1, x + span - s2, x])


def _wrench(of: Task, payload: Payload) -> np.ndarray:
    """Return what the head exerts in the rail's directions: on the wall, and on its own mass."""
    mass = np.array(Pose(payload.head_mass, payload.head_mass, payload.head_inertia))
    return _along_rail(of, mass * rates(rates(of.head)) + of.wrench)


def _carriage_forces(
    of: Task, payload: Payload, position: np.ndarray, speed: np.ndarray, acceleration: np.ndarray
) -> np.ndarray:
    """Return what the carriages themselves take along a rail that moves: mass and friction."""
    speeds = rates(of.rail)
    along = _along_rail(of, rates(speeds))[:, :1]
    absolute = acceleration + along - speeds[:, 2:] ** 2 * position
    return payload.carriage_mass * absolute + payload.friction * np.sign(speed)
