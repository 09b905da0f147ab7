"""Design sweeps: the package, and the grids that a user would lay."""

from __future__ import annotations

import numpy as np

GAP, END = 0.02, 0.5
STEP = 0.001
THRESHOLD, UNIT = 0.001, 0.001
DESIGNS = np.linspace(0.2, 0.45, 251)
SAMPLED = ((0.352, 0.348), (0.30, 0.25))
CLOSE_ENOUGH = 0.02


def index_over(length, half, y, theta, unit=UNIT):
    """Conditioning index from the Jacobian's entries; also the links' projections."""
    sine, cosine = np.sin(theta), np.cos(theta)
    u1, u2 = y - half * sine, y + half * sine
    s1, s2 = np.sqrt(length ** 2 - u1 ** 2), np.sqrt(length ** 2 - u2 ** 2)
    y1, t1 = -u1 / s1, half / unit * (u1 * cosine + s1 * sine) / s1
    y2, t2 = u2 / s2, half / unit * (u2 * cosine - s2 * sine) / s2
    size = 3.0 + y1 ** 2 + y2 ** 2 + t1 ** 2 + t2 ** 2
    cofactors = y1 ** 2 + y2 ** 2 + t1 ** 2 + t2 ** 2 + (y1 - y2) ** 2 + (t1 - t2) ** 2
    determinant = y1 * t2 - y2 * t1
    return 3.0 / np.sqrt(size * (1.0 + cofactors / determinant ** 2)), half * cosine, s1, s2


def grid_sweep():
    """An x-y grid of 1 mm at θ = 0 for each design, some of them: all would take an hour."""
    def area(length, half):
        x, y = np.meshgrid(np.arange(-500, 501) * STEP, np.arange(STEP, length, STEP),
                           indexing='ij')
        with np.errstate(all='ignore'):
            index, span, s1, s2 = index_over(length, half, y, 0.0)
            reachable = ((span - s1 >= GAP) & (x - span + s1 >= -END) & (x + span - s2 <= END))
            return STEP * STEP * (reachable & (index >= THRESHOLD)).sum()

    def run():
        return [area(length, half) for length, half in SAMPLED]

    from facade_manipulator.lab.study.section import section_area
    for found, design in zip(run(), SAMPLED, strict=True):
        exact = section_area(*design, 2.0 * END, GAP, THRESHOLD, UNIT)
        assert abs(found - exact) < CLOSE_ENOUGH * exact, (found, exact)
    return run, len(SAMPLED), []


def closed_sweep():
    from facade_manipulator.lab.study.section import section_area

    length, half = DESIGNS[:, None], DESIGNS[None, :]

    def run():
        return section_area(length, half, 2.0 * END, GAP, THRESHOLD, UNIT)

    return run, len(DESIGNS) ** 2, []


MAKERS = {'sweep: x-y grids': grid_sweep, 'sweep: closed form': closed_sweep}
