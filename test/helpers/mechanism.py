"""Geometries and poses for the tests of kinematics and workspace."""

from collections.abc import Callable
import math
from typing import Any

from hypothesis import assume
from hypothesis import strategies as st
import numpy as np

from facade_manipulator.errors import LimitError
from facade_manipulator.kinematics import (
    Carriages,
    compose,
    Geometry,
    local_conditioning_index,
    Mechanism,
    MIN_CONDITIONING,
    Pose,
)
from facade_manipulator.kinematics.maps import x_intervals
from facade_manipulator.prediction.estimate import EstimateGate, EstimateSettings
from facade_manipulator.study.workspace_metrics import theta_limits, y_range

DESIGN = Geometry()
NO_GAP = Geometry(carriage_gap=0.0)
HOME = Carriages(-0.1, 0.1, 0.0)
VARIANTS = (
    Geometry(0.35, 0.35, carriage_gap=0.0),
    Geometry(0.25, 0.45, carriage_gap=0.0),
    Geometry(0.15, 0.55, stroke=(-0.9, 0.7), carriage_gap=0.01),
    Geometry(0.45, 0.25, carriage_gap=0.0),
    Geometry(0.34, 0.36, carriage_gap=0.03),
)

_fractions = st.floats(0.001, 0.999)
_signed_fractions = st.floats(-0.999, 0.999)


def certify(
    geometry, pose: Pose, min_conditioning: float = MIN_CONDITIONING
) -> Carriages:
    """Return the certified carriages of a pose on a geometry [m]."""
    return Mechanism(geometry).certify(pose, min_conditioning)


def passes(check: Callable[..., object], *arguments: Any) -> bool:
    """Return whether a check accepts its arguments."""
    try:
        check(*arguments)
    except LimitError:
        return False
    return True


def published_motion(rail: Pose, mounting: Pose, axes: float = 0.0) -> Pose:
    """Return the pose that an estimator on a mounting publishes for a pose of the rail."""
    place = compose(rail, mounting)
    seen = compose(Pose(0.0, 0.0, -axes), place)._replace(theta=place.theta)
    return EstimateGate(
        EstimateSettings(mounting=tuple(mounting), axes=axes)
    ).displacement(seen)


def theta_max(geometry: Geometry, y: float) -> float:
    """Return the maximum θ before any limit except the stroke [rad]."""
    return float(theta_limits(geometry, np.array([y]))[0])


@st.composite
def workspace_poses(draw, geometry: Geometry = DESIGN) -> Pose:
    """Draw a pose of the machine's workspace, up to a thousandth from its borders."""
    lower, upper = y_range(geometry)
    y = lower + draw(_fractions) * (upper - lower)
    theta = draw(_signed_fractions) * theta_max(geometry, y)
    (least,), (greatest,) = x_intervals(geometry, y, theta)
    assume(not math.isnan(least))
    return Pose(float(least + draw(_fractions) * (greatest - least)), y, theta)


@st.composite
def regular_poses(draw) -> tuple[Geometry, Pose]:
    """Draw a geometry of `VARIANTS` and a pose on its branch that is not near a singularity."""
    geometry = draw(st.sampled_from(VARIANTS))
    lower, upper = y_range(geometry)
    y = lower + draw(_fractions) * (upper - lower)
    x = draw(st.floats(-0.5, 0.5))
    theta = draw(_signed_fractions) * theta_max(geometry, y)
    pose = Pose(x, y, theta)
    assume(local_conditioning_index(geometry, pose) > 0.01)
    return geometry, pose
