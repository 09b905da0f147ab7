"""The picture of a replay: poses, setpoints and carriages around the stop."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from facade_manipulator.blackbox import RecordedRun
from facade_manipulator.messages import CARRIAGES
from facade_manipulator.tools.replay.poses import carriages, Comparison
from facade_manipulator.tools.replay.stop import StopReplay

RECORDED, REPLAYED, MEASURED, STOP = '#999999', '#0072b2', '#009e73', '#d55e00'
POSES = (('x', 1e3, 'mm'), ('y', 1e3, 'mm'), ('θ', np.degrees(1.0), '°'))
DOTS_PER_INCH = 110


def draw(
    path: Path, run: RecordedRun, poses: Comparison, setpoints: Comparison,
    stop: StopReplay | None, window: tuple[float, float],
) -> None:
    """Draw what lies between two instants [s, from the beginning] and write it as PNG."""
    figure = Figure(figsize=(12, 8), dpi=DOTS_PER_INCH, layout='constrained')
    panels = figure.subplots(3, 2, sharex=True)
    measured = np.array([(time, *carriages(message)) for time, message
                         in run.topics['joint_states']]).reshape(-1, 4)
    for axis, (name, scale, unit) in enumerate(POSES):
        _lines(panels[axis, 0], run, poses, axis, scale)
        panels[axis, 0].set_ylabel(f'corrected {name} [{unit}]')
        panel = panels[axis, 1]
        _lines(panel, run, setpoints, axis, 1e3)
        panel.plot(measured[:, 0] - run.begin, 1e3 * measured[:, 1 + axis], color=MEASURED,
                   lw=0.8, label='measured')
        panel.set_ylabel(f'{CARRIAGES[axis]} [mm]')
    for panel in panels.flat:
        if stop is not None and stop.recorded is not None:
            panel.axvline(stop.recorded.time - run.begin, color=STOP, lw=1.0, label='stop')
        panel.set_xlim(*window)
        panel.grid(alpha=0.3)
    for panel in panels[-1]:
        panel.set_xlabel('time from the beginning of the recording [s]')
    panels[0, 1].legend(loc='upper left', fontsize=8)
    figure.savefig(path)


def _lines(
    panel: Axes, run: RecordedRun, comparison: Comparison, axis: int, scale: float
) -> None:
    times = comparison.times - run.begin
    panel.plot(times, scale * comparison.recorded[:, axis], color=RECORDED, lw=2.4,
               label='recorded')
    panel.plot(times, scale * comparison.replayed[:, axis], color=REPLAYED, lw=0.9,
               label='replayed')
