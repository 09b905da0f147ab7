"""Figures of a run, and an animation of wall, gondola, mechanism and head."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from io import BytesIO
import math
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
import numpy as np
from PIL import Image

from facade_manipulator.errors import LimitError, ManipulatorError
from facade_manipulator.kinematics import compose, Geometry, Pose, relative
from facade_manipulator.kinematics.planar import millimetres, POSE_AXES
from facade_manipulator.simulation.world.scenario import Scenario
from facade_manipulator.study.drawing import (
    BLUE,
    draw_mechanism,
    figure,
    GHOST,
    GREY,
    label,
)

RATE = 100  # Hz, of the samples
PINK = '#CC79A7'
PATHS = (  # paths of a run: colour, name, marker and its size
    (GREY, 'head without compensation', 'o', 6.0),
    (BLUE, 'head with compensation', 'o', 6.0),
    (PINK, 'reference of the head', '+', 14.0),
)
ELAPSED = 'time since the first goal [s]'
RMS_TIME = 1.0  # s, over which an error in the picture is averaged
FRAME_PERIOD = 0.25  # s
#: stamp and planar values of each message of a topic
Table = Sequence[tuple[float, ...]]


class Run:
    """
    Samples of a run from its first reference pose on, interpolated between messages.

    The tables contain head, rail, reference, and wrench of the wall on the head. The three paths
    on the wall [m, m, rad] are: a head at rest on the rail at its reference, the head with
    compensation, and the reference. Raises a ManipulatorError if the run is too short.
    """

    LEAST_DURATION = 0.1  # s
    # s after the first goal, in which the correction fades in and learns
    LEARNING_TIME = 15.0

    def __init__(self, tables: Sequence[Table], scenario: Scenario) -> None:
        self.scenario = scenario
        *poses, wrenches = (np.reshape(table, (-1, 4)) for table in tables)
        begin = max(table[:, 0].min(initial=math.inf) for table in poses)
        end = min(table[:, 0].max(initial=-math.inf) for table in poses)
        if not end - begin >= self.LEAST_DURATION:
            raise ManipulatorError(
                f'report rejected: {max(0.0, end - begin):.3g} s of poses since the first '
                f'reference, minimum {self.LEAST_DURATION:g} s; next: read the logs of the nodes'
            )
        #: since the first reference [s]
        self.times = np.arange(0.0, end - begin, 1.0 / RATE)

        def at_times(table: np.ndarray) -> np.ndarray:
            stamps, *columns = table.T
            times = begin + self.times
            return np.transpose([np.interp(times, stamps, one) for one in columns])

        heads, self.rails, references = map(at_times, poses)
        without = [
            compose(Pose(*rail), Pose(*reference))
            for rail, reference in zip(self.rails, references, strict=True)
        ]
        self.paths = np.array((without, heads, references))
        self.errors = self.paths[:2] - references
        #: whether the figures include the sample
        self.is_counted = self.times >= min(self.LEARNING_TIME, 0.5 * self.times[-1])
        #: along the head [N]; empty without a sensor
        self.forces = -at_times(wrenches)[:, 1] if len(wrenches) else np.zeros(0)

        without_rms, with_rms = np.sqrt(
            np.mean(self.errors[:, self.is_counted] ** 2, axis=1)
        )
        decibels = 20.0 * np.log10(without_rms / with_rms)
        #: RMS error without and with compensation [m, m, rad] and the attenuation [dB], by axis
        self.rms = np.array((without_rms, with_rms, decibels)).T
        self.figures: list[str] = []  #: as text
        self.low: list[str] = []  #: of axes below their limits
        for (name, scale, unit), (before, after, attenuation), least in zip(
            POSE_AXES, self.rms, scenario.mission.attenuation, strict=True
        ):
            is_held = least > -math.inf
            result = f'{attenuation:.3g} dB' if is_held else 'yields to contact'
            errors = f'{scale * before:.3g} → {scale * after:.3g} {unit}'
            text = f'{name} {errors} ({result})'
            self.figures.append(text)
            if attenuation < least:
                self.low.append(f'{text} is below the limit {least:g} dB')


def draw(run: Run) -> dict[str, bytes]:
    """Return the figures and the animation of a run as file contents by file name."""
    figures = {'errors.png': errors(run)}
    if len(run.forces):
        figures['force.png'] = force(run)
    files = {name: BytesIO() for name in (*figures, 'linkage.gif')}
    for name, made in figures.items():
        made.savefig(files[name])

    first, *others = linkage(run)
    first.save(
        files['linkage.gif'],
        'GIF',
        save_all=True,
        append_images=others,
        loop=0,
        duration=round(1e3 * FRAME_PERIOD),
    )
    return {name: file.getvalue() for name, file in files.items()}


AXIS_LABELS = 'x, along the wall', 'y, to the wall', 'θ, yaw'
HIGHEST_FREQUENCY = 10.0  # Hz
AMPLIFICATION = (
    'where blue is above grey, the gondola hardly moves:\n'
    'the head follows the noise of the estimate and the limits of the drives'
)


def errors(run: Run) -> Figure:
    """Plot the errors over time and over frequency."""
    made = figure(
        13, 9, 'Error of the head on the wall: RMS without → with compensation'
    )
    learned, *_, end = run.times[run.is_counted]
    lowest = 1.0 / (end - learned)  # Hz
    rows = made.subplots(3, 2, sharex='col')
    for i, (over_time, by_frequency) in enumerate(rows):
        _, scale, unit = POSE_AXES[i]
        series = scale * run.errors[:, :, i]
        for values, (colour, path, *_) in zip(series, PATHS, strict=False):
            times, rms = _running_rms(run.times, values)
            over_time.plot(times, rms, color=colour, lw=1.0, label=path)
            counted = values[run.is_counted]
            # the spectrum has half the amplitude of a sine
            doubled = 2.0 * (counted - counted.mean())
            by_frequency.magnitude_spectrum(doubled, Fs=RATE, color=colour, lw=1.0)
        over_time.set(yscale='log')
        over_time.axvspan(
            0.0,
            learned,
            color=PINK,
            alpha=0.12,
            lw=0.0,
            label='not counted: the correction fades in and learns',
        )
        by_frequency.set(xscale='log', yscale='log', ylim=(1e-4, 1e3))
        by_frequency.set_xlim(lowest, HIGHEST_FREQUENCY)

        is_last = i == len(rows) - 1
        label(
            over_time,
            ELAPSED if is_last else '',
            f'{AXIS_LABELS[i]}: RMS of {RMS_TIME:g} s [{unit}]',
            f'RMS {run.figures[i]}',
        )
        label(
            by_frequency,
            'frequency [Hz]' if is_last else '',
            f'{AXIS_LABELS[i]}: amplitude [{unit}]',
            AMPLIFICATION if i == 0 else '',
        )
    handles = over_time.get_legend_handles_labels()
    made.legend(*handles, loc='outside lower center', ncols=3)
    return made


def _running_rms(
    times: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the midpoints of all intervals of `RMS_TIME`, and the RMS of the values in each."""
    count = min(len(values), round(RMS_TIME * RATE))
    weights = np.full(count, 1.0 / count)
    mean_squares = np.convolve(values**2, weights, 'valid')
    middles = np.convolve(times, weights, 'valid')
    return middles, np.sqrt(mean_squares)


READINGS = 10  # of the force in a mean, 0.1 s: the noise of a reading is 0.5 N
CONTACT_FORCE = 1.0  # N, above which the averaged force is a contact


def force(run: Run) -> Figure:
    """Plot the force on the wall."""
    made = figure(10, 4.5, 'Force of the head on the wall')
    panel = made.subplots()
    forces = np.convolve(run.forces, np.full(READINGS, 1.0 / READINGS), 'valid')
    times = run.times[READINGS - 1 :]
    panel.plot(times, forces, color=BLUE, lw=1.0, label='mean of 0.1 s')
    panel.axhline(
        CONTACT_FORCE,
        color=GREY,
        ls=':',
        lw=1.0,
        label=f'contact above {CONTACT_FORCE:g} N',
    )
    if desired := run.scenario.compensator.get('contact.force'):
        panel.axhline(desired, color=PINK, ls='--', lw=1.0, label='desired')

    touching = forces[forces > CONTACT_FORCE]
    share = 100.0 * len(touching) / len(forces)
    mean = touching.sum() / max(len(touching), 1)
    title = (
        f'in contact for {share:.3g} % of the time, mean force then {mean:.3g} N, '
        f'highest {forces.max():.3g} N'
    )
    label(panel, ELAPSED, 'force [N]', title)
    made.legend(loc='outside lower center', ncols=3)
    return made


DURATION = 12.0  # s, of the animation


def linkage(run: Run) -> list[Image.Image]:
    """Draw the animation frames of the last seconds of a run."""
    made = figure(8, 5.5, 'The head on the wall, seen from above')
    made.set_dpi(80)
    made.set_layout_engine('compressed')
    panel = made.subplots()
    canvas = FigureCanvasAgg(made)
    images: list[Image.Image] = []
    first = max(0, len(run.times) - round(DURATION * RATE))
    for now in range(first, len(run.times), round(FRAME_PERIOD * RATE)):
        panel.clear()
        draw_moment(panel, run, now)
        if not images:
            made.legend(loc='outside lower center', ncols=3)
            # equal scales change the size of the axes, so the layout settles in two passes
            canvas.draw()
            canvas.draw()
            # a layout of each frame would take as long as drawing
            made.set_layout_engine('none')
        canvas.draw()
        picture = Image.fromarray(np.array(canvas.buffer_rgba()))
        images.append(picture.convert('P'))
    return images


TRAIL = 3.0  # s, of a path in the animation
# m, as drawn; as in config/gondola.xml the pose of the head is that of the tips of its brush
BRUSH_DEPTH = 0.06
BRUSH_WIDTH = 0.3
GONDOLA = Pose(-0.6, -0.15, 0.0)  # corner in frame rail [m]
GONDOLA_SIZE = (1200.0, 120.0)  # mm


def draw_moment(panel: Axes, run: Run, now: int) -> None:
    """
    Draw wall, gondola, mechanism and paths at one sample; the axes cover the whole run.

    The pale mechanism stands still on the rail, as without compensation.
    """
    rail = Pose(*run.rails[now])
    without, head, _ = (Pose(*path[now]) for path in run.paths)
    wall = run.scenario.wall.distance
    panel.axhspan(1e3 * wall, 1e3 * wall + 1e3, color='#c9c2b0', label='wall')
    gondola = compose(rail, GONDOLA)
    _draw_rectangle(panel, gondola, *GONDOLA_SIZE, color='#b7cbd9', label='gondola')
    brush = compose(head, Pose(-0.5 * BRUSH_WIDTH, -BRUSH_DEPTH, 0.0))
    _draw_rectangle(
        panel,
        brush,
        1e3 * BRUSH_WIDTH,
        1e3 * BRUSH_DEPTH,
        color='#b3dfd2',
        label='brush',
    )
    for pose, opacity in (without, GHOST), (head, 1.0):
        with suppress(LimitError):  # an interpolated head may be out of reach
            draw_mechanism(
                panel, Geometry(), relative(rail, pose), alpha=opacity, rail=rail
            )

    begin = max(0, now - round(TRAIL * RATE))
    for (colour, name, marker, size), path in zip(PATHS, run.paths, strict=True):
        x, y, _ = 1e3 * path[begin : now + 1].T
        panel.plot(
            x,
            y,
            color=colour,
            lw=1.0,
            marker=marker,
            ms=size,
            mew=1.5,
            markevery=[-1],
            zorder=4.0,
            label=f'{name}, last {TRAIL:g} s',
        )

    left, low, _ = 1e3 * run.rails.min(axis=0)
    right, _, _ = 1e3 * run.rails.max(axis=0)
    panel.set_xlim(left - 700.0, right + 700.0)
    panel.set_ylim(low - 250.0, 1e3 * wall + 100.0)
    panel.set_aspect('equal')
    before, after = (millimetres(Pose(*values)) for values in run.errors[:, now])
    label(
        panel,
        'x along the wall [mm]',
        'y to the wall [mm]',
        f'{run.times[now]:.1f} s\n'
        f'error without compensation: {before}\nerror with compensation: {after}',
    )


def _draw_rectangle(
    panel: Axes, corner: Pose, width: float, height: float, **style: Any
) -> None:
    """Draw a rectangle of a given size [mm] from a corner pose in frame facade [m, m, rad]."""
    x, y, theta = corner
    angle = math.degrees(theta)
    place = (1e3 * x, 1e3 * y)
    panel.add_patch(Rectangle(place, width, height, angle=angle, lw=0.0, **style))
