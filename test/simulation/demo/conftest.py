"""A recorded run."""

import math

import numpy as np
import pytest

from facade_manipulator.kinematics import Geometry
from facade_manipulator.simulation.demo.recording import run_of, TOPICS
from facade_manipulator.simulation.world.scenario import Scenario
from facade_manipulator.topics import HEAD_POSE, RAIL_POSE, REFERENCE


@pytest.fixture(scope='session')
def run():
    """Return a run with an error of 1 mm at 1 Hz along x on a swaying gondola."""
    rows = {topic: [] for topic in TOPICS}
    for k in range(4000):
        time = 0.0101 * k
        reference = np.array((0.1 * abs(1.0 - time / 6.0 % 2.0), 0.25, 0.0))
        error = np.array((1e-3, 1e-4, 1e-4)) * math.sin(6.2832 * time)
        rows[REFERENCE].append((1e3 + time, *reference))
        rows[HEAD_POSE].append((1e3 + time, *(reference + error)))
        rows[RAIL_POSE].append((1e3 + time, 0.05 * math.sin(time), 0.01, 0.02))
    return run_of(rows, Scenario(), Geometry())
