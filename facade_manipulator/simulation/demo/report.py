"""Figures and pictures of a run, and an animation of wall, gondola, mechanism and head."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from io import BytesIO
import math

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
from facade_manipulator.study.drawing import BLUE, draw_mechanism, figure, GREY, label

RATE = 100  # Hz, of the samples
LEAST_DURATION = 0.1  # s
LEARNING_TIME = (
    15.0  # s after the first goal, in which the correction fades in and learns
)
PINK = '#CC79A7'
PATHS = (  # paths of a run: colour, name, marker and its size
    (GREY, 'head without compensation', 'o', 6.0),
    (BLUE, 'head with compensation', 'o', 6.0),
    (PINK, 'reference of the head', '+', 14.0),
)
AXES = 'x, along the wall', 'y, to the wall', 'θ, yaw'
ELAPSED = 'time since the first goal [s]'
HIGHEST_FREQUENCY = 10.0  # Hz
READINGS = 10  # of the force in a mean, 0.1 s: the noise of a reading is 0.5 N
TOUCH = 1.0  # N, above which the averaged force is a contact
DURATION, FRAME_PERIOD, TRAIL = 12.0, 0.25, 3.0  # s, of the animation
BRUSH, BRUSH_WIDTH = (
    0.08,
    0.3,
)  # m, as drawn; the wall is behind the place of the brush's tips
GONDOLA = Pose(-0.6, -0.15, 0.0), (1200.0, 120.0)  # corner in frame rail [m]; size [mm]
Table = Sequence[
    tuple[float, ...]
]  #: stamp and planar values of each message of a topic


class Run:
    """
    Samples of a run from its first reference, interpolated between the messages.

    The tables are those of head, rail, reference, and wrench of the wall on the head. The three
    paths on the wall [m, m, rad] are: a head at rest on the rail at its reference, the head with
    compensation, and the reference. Raises a ManipulatorError if the run is too short.
    """

    def __init__(self, tables: Sequence[Table], scenario: Scenario) -> None:
        self.scenario = scenario
        *poses, wrenches = (np.reshape(table, (-1, 4)) for table in tables)
        begin = max(table[:, 0].min(initial=math.inf) for table in poses)
        end = min(table[:, 0].max(initial=-math.inf) for table in poses)
        if not end - begin >= LEAST_DURATION:
            raise ManipulatorError(
                f'report rejected: {max(0.0, end - begin):.3g} s of poses since the first '
                f'reference, minimum {LEAST_DURATION:g} s; next: read the logs of the nodes'
            )
        self.times = np.arange(
            0.0, end - begin, 1.0 / RATE
        )  #: since the first reference [s]

        def at_times(table: np.ndarray) -> np.ndarray:
            stamps, *columns = table.T
            return np.transpose(
                [np.interp(begin + self.times, stamps, one) for one in columns]
            )

        heads, self.rails, references = map(at_times, poses)
        without = [
            compose(Pose(*rail), Pose(*reference))
            for rail, reference in zip(self.rails, references, strict=True)
        ]
        self.paths = np.array((without, heads, references))
        self.errors = self.paths[:2] - references
        #: whether the figures include the sample
        self.is_counted = self.times >= min(LEARNING_TIME, 0.5 * self.times[-1])
        #: along the head [N]; empty without a sensor
        self.forces = -at_times(wrenches)[:, 1] if len(wrenches) else np.zeros(0)
        rms = np.sqrt(np.mean(self.errors[:, self.is_counted] ** 2, axis=1))
        #: RMS error without and with compensation [m, m, rad] and the attenuation [dB], by axis
        self.rms = np.array((*rms, 20.0 * np.log10(rms[0] / rms[1]))).T
        self.figures, self.low = (
            list[str](),
            list[str](),
        )  #: as text; of axes below their limits
        for (name, scale, unit), (before, after, attenuation), least in zip(
            POSE_AXES, self.rms, scenario.mission.attenuation, strict=True
        ):
            is_held = least > -math.inf
            self.figures.append(
                f'{name} {scale * before:.3g} → {scale * after:.3g} {unit} '
                + (f'({attenuation:.3g} dB)' if is_held else '(yields to contact)')
            )
            if attenuation < least:
                self.low.append(f'{self.figures[-1]} is below the limit {least:g} dB')


def draw(run: Run) -> dict[str, bytes]:
    """Return the pictures and the animation of a run as files by name."""
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


def errors(run: Run) -> Figure:
    """Draw the errors by time and by frequency, and the compensated errors magnified."""
    made = figure(
        16, 9, 'Error of the head on the wall: RMS without → with compensation'
    )
    learned, *_, end = run.times[run.is_counted]
    for i, (both, magnified, amplitudes) in enumerate(
        made.subplots(3, 3, sharex='col')
    ):
        _, scale, unit = POSE_AXES[i]
        for values, (colour, path, *_) in zip(
            scale * run.errors[:, :, i], PATHS, strict=False
        ):
            both.plot(run.times, values, color=colour, lw=1.0, label=path)
            counted = values[run.is_counted]
            amplitudes.magnitude_spectrum(  # the spectrum has half the amplitude of a sine
                2.0 * (counted - counted.mean()), Fs=RATE, color=colour, lw=1.0
            )
        highest = 1.5 * np.abs(counted).max()
        magnified.plot(run.times, values, color=BLUE, lw=1.0)
        magnified.set_ylim(-highest, highest)
        amplitudes.set(
            xscale='log',
            yscale='log',
            ylim=(1e-4, 1e3),
            xlim=(1.0 / (end - learned), HIGHEST_FREQUENCY),
        )
        for panel, x, title in (
            (both, ELAPSED, f'RMS {run.figures[i]}'),
            (magnified, ELAPSED, 'with compensation, magnified'),
            (amplitudes, 'frequency [Hz]', 'amplitude by frequency'),
        ):
            label(panel, x if i == 2 else '', f'{AXES[i]} [{unit}]', title)
            if x == ELAPSED:
                panel.axvspan(
                    0.0,
                    learned,
                    color=PINK,
                    alpha=0.12,
                    lw=0.0,
                    label='not counted: the correction fades in and learns',
                )
    made.legend(*both.get_legend_handles_labels(), loc='outside lower center', ncols=3)
    return made


def force(run: Run) -> Figure:
    """Draw the force on the wall."""
    made = figure(10, 4.5, 'Force of the head on the wall')
    panel = made.subplots()
    forces = np.convolve(run.forces, np.full(READINGS, 1.0 / READINGS), 'valid')
    panel.plot(
        run.times[READINGS - 1 :], forces, color=BLUE, lw=1.0, label='mean of 0.1 s'
    )
    panel.axhline(TOUCH, color=GREY, ls=':', lw=1.0, label=f'contact above {TOUCH:g} N')
    if desired := run.scenario.compensator.get('contact.force'):
        panel.axhline(desired, color=PINK, ls='--', lw=1.0, label='desired')
    touching = forces[forces > TOUCH]
    label(
        panel,
        ELAPSED,
        'force [N]',
        f'in contact for {100.0 * len(touching) / len(forces):.3g} % of the time, mean force '
        f'then {touching.sum() / max(len(touching), 1):.3g} N, highest {forces.max():.3g} N',
    )
    made.legend(loc='outside lower center', ncols=3)
    return made


def linkage(run: Run) -> list[Image.Image]:
    """Draw the frames of an animation of the last seconds of a run."""
    made = figure(8, 5.25, 'The head on the wall, seen from above')
    made.set_dpi(80)
    panel, canvas, images = made.subplots(), FigureCanvasAgg(made), list[Image.Image]()
    for now in range(
        max(0, len(run.times) - round(DURATION * RATE)),
        len(run.times),
        round(FRAME_PERIOD * RATE),
    ):
        panel.clear()
        draw_moment(panel, run, now)
        if not images:
            made.legend(loc='outside lower center', ncols=3)
            made.draw_without_rendering()
            made.set_layout_engine(
                'none'
            )  # a layout of each frame would take as long as drawing
        canvas.draw()
        images.append(Image.fromarray(np.array(canvas.buffer_rgba())).convert('P'))
    return images


def draw_moment(panel: Axes, run: Run, now: int) -> None:
    """Draw wall, gondola, mechanism and paths at a sample; the axes show the whole run."""
    rail, head = Pose(*run.rails[now]), Pose(*run.paths[1, now])
    wall = run.scenario.wall.distance + BRUSH
    panel.axhspan(1e3 * wall, 1e3 * wall + 1e3, color='#c9c2b0', label='wall')
    for name, colour, frame, (corner, (length, depth)) in (
        ('gondola', '#b7cbd9', rail, GONDOLA),
        (
            'brush',
            '#b3dfd2',
            head,
            (
                Pose(-0.5 * BRUSH_WIDTH, 0.0, 0.0),
                (1e3 * BRUSH_WIDTH, 1e3 * min(BRUSH, wall - head.y)),
            ),
        ),
    ):
        x, y, theta = compose(frame, corner)
        panel.add_patch(
            Rectangle(
                (1e3 * x, 1e3 * y),
                length,
                depth,
                angle=math.degrees(theta),
                color=colour,
                lw=0.0,
                label=name,
            )
        )
    with suppress(LimitError):  # an interpolated head may be out of reach
        draw_mechanism(panel, Geometry(), relative(rail, head), rail=rail)
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
    (left, low, _), (right, _, _) = (
        1e3 * run.rails.min(axis=0),
        1e3 * run.rails.max(axis=0),
    )
    panel.set(
        xlim=(left - 700.0, right + 700.0),
        ylim=(low - 250.0, 1e3 * wall + 100.0),
        aspect='equal',
    )
    without, error = (millimetres(Pose(*values)) for values in run.errors[:, now])
    label(
        panel,
        'x along the wall [mm]',
        'y to the wall [mm]',
        f'{run.times[now]:.1f} s\n'
        f'error without compensation: {without}\nerror with compensation: {error}',
    )
