"""Workspace maps and design sweeps: the package, and the grids that a user would lay."""

from __future__ import annotations

import numpy as np

LENGTH, HALF, GAP, END = 0.352, 0.348, 0.02, 0.5
STEP, TURN, MOST_TURNS = 0.001, np.radians(1.0), 39
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


def count(x, y, theta):
    """Count reachable and good poses of a grid."""
    with np.errstate(all='ignore'):
        index, span, s1, s2 = index_over(LENGTH, HALF, y, theta)
        reachable = ((s1 > 0.0) & (s2 > 0.0) & (span - s1 >= GAP) & (span - s2 >= GAP)
                     & (x - span + s1 >= -END) & (x + span - s2 <= END))
        return reachable.sum(), (reachable & (index >= THRESHOLD)).sum()


def axes():
    """Return x, y and θ of the paper's grid."""
    x = np.arange(-500, 501) * STEP
    y = np.round(np.arange(1, 353) * STEP, 12)
    return x, y, np.arange(-MOST_TURNS, MOST_TURNS + 1) * TURN


def meshgrid_map():
    """Lay the whole grid and compute on it."""
    def run():
        return count(*np.meshgrid(*axes(), indexing='ij'))

    return run, 1, run()


def meshgrid_part():
    """Lay every eighth angle of the whole grid: its time is a share of the whole one's."""
    x, y, turns = axes()
    part = turns[::8]

    def run():
        return count(*np.meshgrid(x, y, part, indexing='ij'))

    return run, len(part) / len(turns), []


def blocked_map():
    """One angle at a time."""
    def run():
        x, y, turns = axes()
        counts = [count(x[:, None], y[None, :], theta) for theta in turns]
        return np.sum(counts, axis=0)

    return run, 1, run()


def ours_map():
    from facade_manipulator.kinematics import Geometry
    from facade_manipulator.lab.study.gcw import count_poses, Grid

    geometry, grid = Geometry(), Grid(STEP, STEP)

    def run():
        return count_poses(geometry, grid, THRESHOLD, UNIT)

    return run, 1, run()[:2]


def ours_map_memory():
    """No time but the greatest memory in MiB that a map takes on top."""
    import tracemalloc

    run, _, _ = ours_map()
    tracemalloc.start()
    run()
    peak = tracemalloc.get_traced_memory()[1] / 2 ** 20
    tracemalloc.stop()
    return (lambda: None), 1, [peak]


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


def numeric_sweep():
    """The index at every mm of y, the width in x in closed form; one link length at a time."""
    from facade_manipulator.kinematics import squared_index

    y = np.arange(1, 451) * STEP
    halves = np.array_split(DESIGNS[:, None], 16)  # so that a block stays in the cache

    def area(length, half):
        s = np.sqrt(np.maximum(0.0, length * length - y * y))
        inside = np.flatnonzero((s > 0.0) & (s <= half.max() - GAP))
        rows, s = slice(inside[0], inside[-1] + 1), s[inside]
        ratio = half / UNIT
        good = squared_index(
            (0.0, 1.0, y[rows], y[rows], s, s), ratio, ratio) >= THRESHOLD ** 2
        width = 2.0 * (END - half + s)
        good &= (half - s >= GAP) & (width > 0.0)
        return STEP * (width * good).sum(axis=1)

    def run():
        return np.array([
            np.concatenate([area(length, half) for half in halves]) for length in DESIGNS])

    from facade_manipulator.lab.study.section import section_area
    exact = section_area(DESIGNS[:, None], DESIGNS, 2.0 * END, GAP, THRESHOLD, UNIT)
    assert np.abs(run() - exact).max() < CLOSE_ENOUGH * exact.max()
    return run, len(DESIGNS) ** 2, []


MAKERS = {
    'map: ours': ours_map, 'map: numpy meshgrid': meshgrid_map, 'map: numpy blocks': blocked_map,
    'map: numpy meshgrid, part': meshgrid_part,
    'map: ours, memory': ours_map_memory,
    'sweep: x-y grids': grid_sweep, 'sweep: numeric y': numeric_sweep,
    'sweep: closed form': closed_sweep,
}
