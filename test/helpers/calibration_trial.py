"""Made-up machines, calibrated: how often the truth is within three deviations, and the head."""

from __future__ import annotations

from typing import NamedTuple

from machines import make_machine, measure_heads, ShopSettings
import numpy as np

from facade_manipulator.calibration import (
    candidates,
    heads,
    identify,
    Measurements,
    plan,
    spread,
    UNKNOWNS,
    values_of,
)
from facade_manipulator.kinematics import Geometry

DRAWING = Geometry()
POSES = 24
HELD_OUT = 60


class Trial(NamedTuple):
    """
    What calibrating many machines came to.

    Parameters
    ----------
    deviations : ndarray, shape (machines, unknowns)
        Found less true, in standard deviations.
    before, after, share : ndarray, shape (machines, 3)
        RMS of the head's error at held-out poses, and what the noise alone is expected to leave.
    blamed : int
        Good measurements taken for outliers.

    """

    deviations: np.ndarray
    before: np.ndarray
    after: np.ndarray
    share: np.ndarray
    blamed: int

    @property
    def within(self) -> float:
        """Share of parameters within three deviations of the truth."""
        return float((np.abs(self.deviations) < 3.0).mean())


def run(machines: int, seed: int = 1, shop: ShopSettings | None = None) -> Trial:
    """Make, measure and calibrate machines."""
    shop, random = shop or ShopSettings(), np.random.default_rng(seed)
    poses, permitted = plan(DRAWING, UNKNOWNS, POSES), candidates(DRAWING)
    rows, blamed = [], 0
    for _ in range(machines):
        made = make_machine(DRAWING, shop, random)
        held = permitted[random.choice(len(permitted), HELD_OUT, replace=False)]
        found = identify(
            DRAWING, UNKNOWNS, Measurements(poses, measure_heads(made, poses, shop, random)))
        blamed += len(found.outliers)
        truth = heads(made, held)
        rows.append((
            (found.values - values_of(made, UNKNOWNS)) / np.sqrt(np.diag(found.covariance)),
            rms(truth - heads(DRAWING, held)), rms(truth - heads(found.geometry, held)),
            rms(spread(found.geometry, UNKNOWNS, found.covariance, held))))
    return Trial(*(np.array(column) for column in zip(*rows, strict=True)), blamed)


def rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt((values ** 2).mean(axis=0))


def table(trial: Trial) -> str:
    """Return the result as a table."""
    lines = [f'machines {len(trial.deviations)}, parameters within 3 sigma {trial.within:.2%}, '
             f'good measurements blamed {trial.blamed}',
             f'{"":8s}{"before":>10s}{"after":>10s}{"noise share":>13s}{"ratio":>8s}']
    for k, (axis, factor, unit) in enumerate(
            (('x', 1e3, 'mm'), ('y', 1e3, 'mm'), ('theta', 180.0 / np.pi, 'deg'))):
        before, after, share = (factor * rms(column[:, k]) for column in (
            trial.before, trial.after, trial.share))
        lines.append(f'{axis:8s}{before:10.3f}{after:10.3f}{share:13.3f}{after / share:8.2f} '
                     f'{unit}')
    return '\n'.join(lines)


if __name__ == '__main__':
    print(table(run(200)))
