"""What the demo leaves: summary.json and a picture of the time courses."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

AXES = ('x', 'y', 'theta')
UNITS = {'x': ('mm', 1e3), 'y': ('mm', 1e3), 'theta': ('°', math.degrees(1.0))}
TITLES = {'x': 'x, along the wall', 'y': 'y, to the wall', 'theta': 'θ, yaw'}
COLOURS = {'disturbance': '#999999', 'error': '#0072b2', 'goal': '#d55e00'}
POINTS_DRAWN = 4000


class Sample(NamedTuple):
    """One moment: time since the first goal [s] and (x, y, θ) of goal, disturbance and error."""

    time: float
    goal: tuple[float, float, float]
    disturbance: tuple[float, float, float]
    error: tuple[float, float, float]


def write_json(path: Path, content: Any) -> None:
    """Write a JSON file whole or not at all."""
    draft = path.with_suffix('.part')
    draft.write_text(json.dumps(content, indent=2) + '\n')
    draft.replace(path)


def draw(path: Path, samples: list[Sample], summary: dict) -> None:
    """Draw the time courses of goal, disturbance and error on the wall."""
    import matplotlib

    matplotlib.use('Agg')
    import matplotlib.pyplot as plt

    step = max(1, len(samples) // POINTS_DRAWN)
    kept = samples[::step]
    time = np.array([sample.time for sample in kept])
    figure, panels = plt.subplots(len(AXES), 1, sharex=True, figsize=(10, 9), layout='constrained')
    for index, (axis, panel) in enumerate(zip(AXES, panels, strict=True)):
        _draw_axis(panel, axis, time, {
            name: np.array([getattr(sample, name)[index] for sample in kept])
            for name in ('disturbance', 'error', 'goal')})
        panel.set_title(_title(axis, summary['axes'][axis]), loc='left', fontsize=10)
    panels[0].legend(loc='upper right', ncols=3, frameon=False, bbox_to_anchor=(1.0, 1.2))
    panels[-1].set_xlabel('time since the first goal [s]')
    figure.suptitle('The head on the wall while the gondola sways', fontsize=13)
    draft = path.with_suffix('.part')
    figure.savefig(draft, format='png', dpi=120)
    plt.close(figure)
    draft.replace(path)


def _draw_axis(panel, axis: str, time: np.ndarray, courses: dict[str, np.ndarray]) -> None:
    unit, scale = UNITS[axis]
    goal = scale * courses['goal']
    centre = goal[0] if len(goal) else 0.0
    panel.plot(time, scale * courses['disturbance'], color=COLOURS['disturbance'], lw=1.0,
               label='without compensation')
    panel.plot(time, scale * courses['error'], color=COLOURS['error'], lw=1.2,
               label='error on the wall')
    panel.plot(time, goal - centre, color=COLOURS['goal'], lw=1.0, ls='--',
               label='goal, from its first place')
    panel.set_ylabel(f'{TITLES[axis]} [{unit}]')
    panel.grid(alpha=0.3)
    panel.margins(x=0.01)


def _title(axis: str, result: dict[str, float]) -> str:
    unit, scale = UNITS[axis]
    if result['attenuation_db'] is None:
        return 'too short for figures: no goal stood long enough'
    return (f'RMS {scale * result["disturbance_rms"]:.3g} {unit} → '
            f'{scale * result["residual_rms"]:.3g} {unit} '
            f'({result["attenuation_db"]:.1f} dB), while the goal stands')
