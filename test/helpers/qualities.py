"""The qualities of service of the table of interfaces, for the tests' own endpoints."""

from __future__ import annotations

from facade_manipulator import interfaces
from facade_manipulator.ros.interfaces import profile

LATEST, RELIABLE, LATCHED, RECENT = map(profile, (
    interfaces.LATEST, interfaces.RELIABLE, interfaces.LATCHED, interfaces.RECENT))
DRIVER_STATUS, GOAL_STATUS = interfaces.DRIVER_STATUS.name, interfaces.GOAL_STATUS.name
