"""The three-dimensional workspace (Figure 6): slices of constant θ, coloured by their index."""

from __future__ import annotations

from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_rgba
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
import numpy as np

from facade_manipulator.kinematics import Geometry
from facade_manipulator.workspace.drawing import (
    COLOUR_MAP,
    figure,
    GREY,
    lengths,
    MILLIMETRES,
    Study,
)
from facade_manipulator.workspace.maps import pose_map
from facade_manipulator.workspace.volume import theta_bounds

SLICES, ROWS = 27, 70
CHARACTERISTIC_LENGTH = 1.0  # shows weak poses near the rail as well as at the far edge


def figure_6(study: Study) -> Figure:
    """Draw the workspace of the paper's example and of the design."""
    # The constrained layout does not know the extent of 3-D axes.
    made = figure(10.0, 4.6, 'Figure 6: workspace over x, y and θ', layout='none')
    made.subplots_adjust(left=0.06, right=0.87, bottom=0.0, top=0.93, wspace=0.1)
    stroke = study.geometry.stroke
    example = Geometry(0.25, 0.45, stroke, 0.0)
    scale = Normalize(0.0, 0.45)
    for place, geometry in enumerate((example, study.geometry), start=1):
        axes = made.add_subplot(1, 2, place, projection='3d')
        _draw(axes, geometry, scale)
        axes.set_title(lengths(geometry), y=0.99)
    made.colorbar(ScalarMappable(scale, COLOUR_MAP), cax=made.add_axes((0.91, 0.2, 0.015, 0.6)),
                  label='LCI, characteristic length 1 m (grey: beyond N = 0)')
    return made


def _draw(axes, geometry: Geometry, scale: Normalize) -> None:
    """Draw the slices of a workspace, strip by strip of y."""
    y = np.linspace(1e-6, geometry.link_length, ROWS + 1)
    end = np.nanmax(theta_bounds(geometry, y))
    theta = np.linspace(-end, end, SLICES)
    of = pose_map(geometry, y[:, None], theta, CHARACTERISTIC_LENGTH)
    strips, colours = [], []
    colour_of = ScalarMappable(scale, COLOUR_MAP).to_rgba
    for row, column in np.argwhere(~np.isnan(of.lower[:-1] + of.lower[1:])):
        corners = ((of.lower[row, column], y[row]), (of.upper[row, column], y[row]),
                   (of.upper[row + 1, column], y[row + 1]),
                   (of.lower[row + 1, column], y[row + 1]))
        strips.append([(x * MILLIMETRES, at * MILLIMETRES, np.degrees(theta[column]))
                       for x, at in corners])
        beyond = of.number[row, column] <= 0.0
        colours.append(to_rgba(GREY, 0.2) if beyond
                       else (*colour_of(of.index[row, column])[:3], 0.85))
    axes.add_collection3d(Poly3DCollection(strips, facecolors=colours, edgecolors='none',
                                              antialiased=False))
    _frame(axes, geometry, end)


def _frame(axes, geometry: Geometry, end: float) -> None:
    reach = geometry.stroke_length * 0.5 * MILLIMETRES
    axes.set(xlim=(-reach, reach), ylim=(0.0, geometry.link_length * MILLIMETRES),
             zlim=(-np.degrees(end), np.degrees(end)), xlabel='x [mm]', ylabel='y [mm]')
    axes.zaxis.set_rotate_label(False)
    axes.set_zlabel('θ [deg]', rotation=90.0)
    for axis, count in (('x', 5), ('y', 4), ('z', 6)):
        axes.locator_params(axis=axis, nbins=count)
    axes.view_init(elev=24.0, azim=52.0)  # from the façade: what lies beyond N = 0 is behind
    axes.set_box_aspect((1.3, 1.0, 0.9), zoom=1.0)
