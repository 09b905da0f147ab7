"""What each growth meets first, in a message, from what was measured."""

from __future__ import annotations

import os

Growth = dict[str, dict]
PROCESSOR = 'CPU [%]'


def add_bottlenecks(growth: Growth) -> None:
    """Name the first bottleneck in each growth."""
    for title, one in growth.items():
        one['bottleneck'] = NAMED[title](one)


def of_batches(one: dict) -> str:
    """Below some poses the calls cost more than the poses; beyond the cache memory does."""
    words = []
    for label, costs in one['lines'].items():
        least = min(costs)
        enough = next(at for at, cost in zip(one['at'], costs, strict=True) if cost < 2.0 * least)
        words.append(f'{label}: calls of numpy below {enough:,} poses, at {one["at"][-1]:,} '
                     f'{costs[-1] / least:.2f} of the least cost')
    return '; '.join(words)


def of_grid(one: dict) -> str:
    """Cells of (y, θ) are worked at, and columns of x cost nothing."""
    (costs,) = one['lines'].values()
    finer, costlier = one['at'][0] / one['at'][-1], costs[-1] / costs[0]
    return (f'calls of numpy, then the cells of y: {finer:g} times as fine in x and y costs '
            f'{costlier:.1f} times as much, not {finer ** 2:g}')


def of_rate(one: dict) -> str:
    """All callbacks of a process share one thread."""
    shares = one['lines'][PROCESSOR]
    full = one['at'][-1] * 100.0 / shares[-1]
    return (f'the one thread of the executor: {shares[-1]:.0f} % of a core at '
            f'{one["at"][-1]:g} Hz, so full at about {full:.0f} Hz')


def of_manipulators(one: dict) -> str:
    """The processes share nothing but the processor."""
    shares, late = one['lines'][PROCESSOR], one['lines']['p99 [µs]']
    each = (shares[-1] - shares[0]) / (one['at'][-1] - one['at'][0])
    cores = os.cpu_count()
    return (
        f'the processor: {each:.1f} % of a core each, {100.0 * cores / each:.0f} fill {cores} '
        f'cores; p99 with {one["at"][-1]} is {late[-1] / late[0]:.1f} times that of one')


NAMED = {
    'Batch kinematics': of_batches, 'Workspace map': of_grid,
    'Deployment by rate': of_rate, 'Manipulators at 100 Hz': of_manipulators,
}
