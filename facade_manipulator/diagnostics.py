"""
Components and keys of /diagnostics: the one table of them, without ROS.

The nodes publish no other key, which the tests look at; the demo takes
the names from here, and docs/diagnostics.md is made from it (test/test_diagnostics.py). A ``*``
stands for what only the machine knows, such as the reason of a rejection.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
import re
from typing import Any, NamedTuple

REJECTED, LAST_REJECTION = 'rejected', 'last rejection'
REJECTIONS = {
    REJECTED: 'messages and requests that were rejected',
    'rejected: *': 'of these, for that reason (operation.md)',
    LAST_REJECTION: 'the last one, in words',
}


@dataclass(frozen=True)
class DiagnosticComponent:
    """A component: when it warns and what is wrong at an error, its keys and their meaning."""

    node: str
    name: str  #: ``*``: of an axis
    levels: str
    keys: Mapping[str, str]

    def __str__(self) -> str:
        """Return the name in /diagnostics, without the namespace."""
        return f'{self.node}: {self.name}'

    def key(self, name: str) -> str:
        """Return a key; a KeyError if the component has none of the name."""
        if not self.has(name):
            raise KeyError(f'{self} has no {name!r}')
        return name

    def has(self, key: str) -> bool:
        """Return whether the component has a key."""
        return key in self.keys or any(one.fullmatch(key) for one in self._patterns)

    @cached_property
    def _patterns(self) -> tuple[re.Pattern[str], ...]:
        return tuple(re.compile(pattern(key)) for key in self.keys if '*' in key)


class Report(NamedTuple):
    """A component's last diagnostic status and when it was received [s, monotonic]."""

    received: float
    status: Any  #: as rclpy has it, or a file


OPERATION = DiagnosticComponent(
    'driver', 'operation',
    'warn: halted, or something was rejected or late; error: stopped, bus or control loop lost, '
    'a second publisher or driver', {
        'state': 'what the drives do as a group',
        'power': 'confirmed off, unknown or on, of each drive that differs',
        'activity': 'what the carriages do while the state is active',
        'cause': 'why they stopped or halted',
        'next step': 'what to do now',
        'further causes': 'what went wrong after the cause',
        'notes': 'what is unusual and stops nothing',
        'not homed': 'axes without a reference',
        'limited cycles': 'cycles in which a limit of motion slowed the setpoints',
        'brakes': 'times that the stream of setpoints broke off in motion',
        'last brake': 'why the last time',
        'states dropped': 'joint states that nobody took from the loop in time',
        'setpoint margin p1 [ms]': 'how early setpoints come; 99 % are earlier',
        'setpoint margin p50 [ms]': 'the median of that',
        'drive faults': 'stops since the start of the node',
        'targets ahead of their SYNC [ms]':
            'from the SYNC that latches a target to the instant it is meant for',
        'version': 'of this package, with the commit where it is known',
        'profiles': 'checksums of the drive profiles and EDS that were read last',
        'limits changed': 'when limits of motion were changed last, from what to what',
        **REJECTIONS,
    })
BUS = DiagnosticComponent(
    'driver', 'bus', 'warn: late cycles, no real-time priority; error: the bus is lost', {
        'cycles': 'of the control loop on this bus',
        'missed cycles': 'those in which an answer to their SYNC was missing',
        'late commands': 'those whose commands came after the window',
        'skipped SYNCs': 'those that were left out, since the computer was late',
        'worst lateness [ms]': 'of a cycle',
        'late share [%]': 'of the last 500 cycles',
        'lateness below * ms': 'cycles by how late they were',
        'lateness beyond': 'cycles that were later than all these',
        'worst-case load [%]': 'of the bus, by the length of all frames of a cycle',
        'received': 'frames',
        'sent': 'frames',
        'ignored': 'frames of nobody that the driver knows',
        'error frames': 'reported by the interface',
        'overflows': 'times that frames were lost in the computer',
        'condition': 'of the interface: active, warning, passive or off',
    })
AXIS = DiagnosticComponent(
    'driver', 'q*', 'error: fault; stale: silent, what stands here is old', {
        'node id': 'on the bus',
        'statusword': 'as it came last',
        'power': 'by the statusword',
        'homed': 'whether the reference is known',
        'position [m]': 'actual',
        'velocity [m/s]': 'actual',
        'force [N]': 'along the rail, by the torque of the drive',
        'following error [m]': 'of the drive',
        'target [m]': 'as commanded last',
        'digital inputs': 'limit and home switches among them',
        'error code': 'of the last emergency message',
        'heartbeat age [s]': 'since the last heartbeat',
        'missed': 'answers that did not come in their cycle',
    })
GOAL = DiagnosticComponent(
    'ik_service', 'goal',
    'warn: no goal is followed; error: the last one was rejected, or an input has two '
    'publishers', {
        'setpoints': 'sent', **REJECTIONS})
CORRECTION = DiagnosticComponent(
    'compensator', 'correction',
    'warn: disabled, no estimate, or held back; error: the estimator is silent or rejected, or an '
    'input has two publishers', {
        'horizon [ms]': 'for how far ahead poses are predicted',
        'corrected poses': 'published',
        'age of the estimate [ms]': 'of its stamp',
        'lag of the head [ms]': 'as measured, behind the corrected poses',
        'initialisations': 'times that the path to the goal began at the head',
        'left out of the estimate': 'height and tilt of the newest one, out of the plane',
        'corrected disturbance': 'as predicted',
        'saturation error': 'what the limits of the workspace leave uncorrected',
        'tracking error': 'what the limits of motion leave uncorrected',
        'standard deviation of the prediction':
            'when the head gets there, and what the estimator adds by noise, rate and latency',
        **REJECTIONS,
    })
CONTACT = DiagnosticComponent(
    'compensator', 'contact', 'while in use; warn: an obstacle; error: the head was retracted', {
        'pressing': 'what becomes of it',
        'force on the wall [N]': 'as measured',
        'desired force [N]': 'press.force',
        'bound of its error [N]': 'within which it counts as reached',
        'zero of the force [N]': 'what the sensor shows off the wall',
        'force of the moment desired [N]': 'on the way to it',
        'force, mean of 10 s [N]': 'as measured',
        'force, RMS error of 10 s [N]': 'from the desired one',
        'share off the wall of 10 s [%]': 'of the time',
        'stiffness of the contact [N/mm]': 'as estimated',
        'moment on the wall [N m]': 'as measured',
        'push-back of the gondola [mm]': 'by the force',
        'sway of the gondola, envelope': 'how far it goes at most, as estimated',
        'retracted last because': 'or never',
        'shift of the goal': 'by force and slip',
    })
WORLD = DiagnosticComponent(
    'gondola_simulator', 'world', 'none', {
        'real-time factor': 'simulated time by the time that its computing took', **REJECTIONS})
MOTION = DiagnosticComponent(
    'disturbance_estimator', 'motion',
    'warn: without an inertial sensor; error: an axis is not known, all of it is wrong, or a '
    'sensor has two publishers', {
        'standard deviation of * [*]': 'of each axis, as published',
        'event *': 'the last ones: starts, levels found, the inertial sensor lost and back',
        **REJECTIONS,
    })
SENSOR = DiagnosticComponent(
    'disturbance_estimator', 'sensor *', 'warn: silent, rejected, or most of it fits nothing', {
        'rate [Hz]': 'of its measurements',
        'age on arrival [ms]': 'by its stamps',
        'normalised innovation squared': 'mean; 1 where its noise is as the parameters say',
        'delay found [ms]': 'how late its stamps are, and the standard deviation; of a fix alone',
        'measurements: *': 'by what became of them: used, other level, outlier, …',
    })
COMPONENTS = (
    OPERATION, BUS, AXIS, GOAL, CORRECTION, CONTACT, MOTION, SENSOR, WORLD)
BY_NAME = {one.name: one for one in COMPONENTS}


def unknown_keys(component: str, keys: Iterable[str]) -> list[str]:
    """Return the keys that the table does not have for a component of a node, without its name."""
    named = AXIS if not component.startswith('sensor ') else SENSOR
    known = BY_NAME.get(component, named)
    return [key for key in keys if not known.has(key)]


def pattern(key: str) -> str:
    """Return the regular expression of a key."""
    return re.escape(key).replace(r'\*', '.+')
