"""
Diagnostic components of the compensator.

A component is its name, its level (ok, warn or error), a message and values by key, without ROS.
"""

from __future__ import annotations

import math
from typing import Any

from facade_manipulator.compensation.contact_phases import Pressing
from facade_manipulator.compensation.correction import CorrectionMode
from facade_manipulator.compensation.pose_compensator import Compensator
from facade_manipulator.errors import joined, NEXT
from facade_manipulator.kinematics.planar import millimetres, POSE_AXES

Component = tuple[str, str, str, dict[str, Any]]
UNESTIMATED = (CorrectionMode.NO_ESTIMATE, CorrectionMode.SILENT)
UNCORRECTED = (CorrectionMode.DISABLED, CorrectionMode.NO_ESTIMATE)


def correction_outcome(
    compensator: Compensator, now: float, fault: str
) -> tuple[str, str]:
    """Return level and message at a time [s]; `fault` is a fault of the input topics."""
    correction = compensator.correction
    mode = correction.mode
    text = mode.value
    addition = fault or compensator.held_back.message(now)
    if mode in UNESTIMATED:
        cause = correction.silence_cause(now)
        text = f'{text}: {cause}'
        addition = _without_repetition(addition, cause)
    if not addition and mode not in UNESTIMATED:
        addition = correction.unmeasured_axes()
    level = 'warn' if addition or mode in UNCORRECTED else 'ok'
    if fault or mode is CorrectionMode.SILENT:
        level = 'error'
    return level, joined(text, addition)


def _without_repetition(fault: str, cause: str) -> str:
    """Return a fault without the problems that a cause of silence already contains."""
    problems, separator, step = fault.partition(NEXT)
    others = [problem for problem in problems.split('; ') if problem not in cause]
    return f'{"; ".join(others)}{separator}{step}' if others else ''


def correction_component(
    compensator: Compensator, now: float, fault: str, left_out: tuple[float, float]
) -> Component:
    """Return the component of the correction; `left_out` is height and tilt [m, rad]."""
    correction = compensator.correction
    lag = compensator.following.lag
    horizon = compensator.settings.lead
    newest = compensator.newest
    values: dict[str, Any] = {
        'horizon [ms]': 1e3 * horizon,
        'age of the estimate [ms]': 1e3 * correction.age(now),
        'lag of the head [ms]': 1e3 * lag,
        'initialisations': compensator.initialisations,
    }
    if any(left_out):
        values['left out of the estimate'] = (
            f'z {1e3 * left_out[0]:+z.1f} mm, tilt {math.degrees(left_out[1]):.2f} deg'
        )
    if newest is not None:
        values['corrected disturbance'] = millimetres(newest.disturbance)
        values['saturation error'] = millimetres(newest.saturation_error)
    deviations = correction.deviations(now + horizon + lag)
    if deviations:
        texts = []
        for axis, deviation, is_usable in zip(
            POSE_AXES, deviations, correction.usable, strict=True
        ):
            name, scale, unit = axis
            # the prediction of an axis that is not usable does not describe the rail
            known = deviation if is_usable else math.inf
            texts.append(f'{name} {scale * known:.2g} {unit}')
        values['standard deviation of the prediction'] = '; '.join(texts)
    return 'correction', *correction_outcome(compensator, now, fault), values


def contact_components(compensator: Compensator) -> list[Component]:
    """Return the component of the contact, or none while it is disabled and shifts no goal."""
    contact = compensator.contact
    pressing = contact.pressing
    is_enabled = contact.lateral.enabled or pressing.settings.enabled
    if not is_enabled and not any(contact.present):
        return []
    level = 'ok'
    if pressing.is_hindered:
        level = 'error' if pressing.reason else 'warn'
    values = pressing_values(pressing) | {
        'zero of the force [N]': pressing.zero,
        'desired force at present [N]': pressing.desired,
        'moment on the wall [N m]': pressing.moment,
        'reason of the last retract': pressing.last_reason or 'never',
        'shift of the goal': millimetres(contact.present),
    }
    return [('contact', level, pressing.outcome, values)]


def pressing_values(pressing: Pressing) -> dict[str, Any]:
    """Return state and force of the wall contact as values."""
    return {
        'pressing': pressing.outcome,
        'force on the wall [N]': pressing.monitor.force,
        'desired force [N]': pressing.settings.force,
        'bound of the force error [N]': pressing.bound,
    }
