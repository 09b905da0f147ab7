"""
Home position of each homing method of a simulated drive. The carriage moves there directly.

References
----------
CiA 402-2, homing mode: methods 1 to 37. Methods -1 to -4 (hard stop found by the motor current)
are maxon's.

"""

from __future__ import annotations

import math

from facade_manipulator.simulation.drives.motor import SimulatedMotor

# by method: an edge, as named in SimulatedMotor, None for the present position; the side of the
# rail's middle that it is on; in which direction the index pulse follows, 0 for none
METHODS: dict[int, tuple[str | None, int, int]] = {
    37: (None, 0, 0), 35: (None, 0, 0), 34: (None, 0, 1), 33: (None, 0, -1),
    17: ('limit_switch', -1, 0), 1: ('limit_switch', -1, 1),
    18: ('limit_switch', 1, 0), 2: ('limit_switch', 1, -1),
    23: ('home_switch', -1, 0), 7: ('home_switch', -1, -1),
    27: ('home_switch', 1, 0), 11: ('home_switch', 1, 1),
    -4: ('hard_stop', -1, 0), -2: ('hard_stop', -1, 1),
    -3: ('hard_stop', 1, 0), -1: ('hard_stop', 1, -1)}


def find_home(method: int, motor: SimulatedMotor) -> float | None:
    """Return the home position of a method [counts], None if its switch is missing."""
    edge, side, direction = METHODS[method]
    distance = getattr(motor, edge) if edge else 0.0
    if edge and not distance:
        return None
    home = side * distance if edge else motor.position
    revolution = motor.counts_per_revolution  # on which there is one index pulse
    if direction > 0:
        home = revolution * (math.floor(home / revolution) + 1)
    elif direction < 0:
        home = revolution * (math.ceil(home / revolution) - 1)
    return home
