"""The picture of a design; whoever imports this module imports matplotlib with it."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from facade_manipulator.lab.gondola.pictures import label, new_figure
from facade_manipulator.lab.sizing.axis_drive import AXES, Duty, torques
from facade_manipulator.lab.sizing.candidates import Candidate
from facade_manipulator.lab.sizing.demand import STEP

COLOURS = '#0072B2', '#D55E00', '#009E73'  # Okabe and Ito's
MINUTE = 60.0  # s


def draw(candidates: list[Candidate], chosen: Candidate, duty: Duty) -> Figure:
    """Draw the front, what the carriages do, and what the motors do inside their limits."""
    geometry = chosen.design.geometry
    figure = new_figure(14, 8, f'l = {1e3 * geometry.link_length:.0f} mm, b = '
                        f'{1e3 * geometry.platform_half_length:.0f} mm, {chosen.drive.name}')
    front, size, course, motor = figure.subplots(2, 2).flat
    _front(front, candidates, chosen, 'power', 'rated power of a motor [W]')
    _front(size, candidates, chosen, 'area', 'area at θ = 0 [m²]')
    worst = max(chosen.design.demands, key=lambda of: float(np.abs(of.power).max()))
    times = STEP * np.arange(len(worst.position))
    torque = torques(chosen.drive, worst, duty)
    for i, colour in enumerate(COLOURS):
        course.plot(times, worst.position[:, i], color=colour, lw=1.0, label=AXES[i])
        motor.plot(MINUTE * chosen.drive.turns * worst.speed[:, i], torque[:, i], color=colour,
                   lw=0.6)
    for stop in geometry.stroke:
        course.axhline(stop, color='#777777', lw=1.0, ls='--')
    course.legend(ncols=3, fontsize=8)
    label(course, 'time [s]', 'carriages, and the ends of the stroke [m]')
    one = chosen.drive.motor
    for speed, limit, text in ((one.rated_speed, one.rated_torque, 'rated'),
                               (one.peak_speed, one.peak_torque, 'peak')):
        motor.plot(MINUTE * speed * np.array((-1, 1, 1, -1, -1)),
                   limit * np.array((1, 1, -1, -1, 1)), color='#777777', lw=1.0,
                   ls='-' if text == 'rated' else '--', label=text)
    motor.legend(fontsize=8)
    label(motor, 'speed of the motors [rev/min]', 'torque [N m]')
    return figure


def _front(
    panel: Axes, candidates: list[Candidate], chosen: Candidate, name: str, text: str
) -> None:
    found = panel.scatter(
        [one.rail for one in candidates], [getattr(one, name) for one in candidates],
        c=[one.margin for one in candidates], s=12, cmap='viridis')
    panel.plot(chosen.rail, getattr(chosen, name), 'o', ms=12, mfc='none', color=COLOURS[1])
    panel.figure.colorbar(found, ax=panel, label='margin')
    label(panel, 'stroke of the carriages [m]', text)
