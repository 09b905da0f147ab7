"""The workspace at one angle as a grid of cells, for an operator's map."""

from __future__ import annotations

import numpy as np

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry, mechanism_of, Pose
from facade_manipulator.workspace.maps import pose_map

UNREACHABLE = -1
FULL = 100
MAX_CELLS = 4_000_000


def lci_grid(
    geometry: Geometry, theta: float, resolution: float, characteristic_length: float = 1.0
) -> tuple[np.ndarray, Pose]:
    """
    Conditioning over x and y at the angle θ, as nav_msgs/OccupancyGrid wants it.

    The grid covers the stroke and the links' length, whatever θ, so that it stays in place.

    Parameters
    ----------
    geometry : Geometry
    theta : float
        [rad].
    resolution : float
        Side of a cell [m].
    characteristic_length : float
        Unit of length of the index [m].

    Returns
    -------
    cells : ndarray of int8, shape (rows of y, columns of x)
        100·LCI over the greatest LCI at this θ, taken at the cell's centre; −1 where the machine
        cannot stand.
    origin : Pose
        Outer corner of the first cell and the direction of its rows, in frame `rail`: with tool
        and rail angle of the machine. Errors of its lengths are not in the map.

    Raises
    ------
    ParameterError
        If θ is not finite, or the resolution not positive or so fine that the grid would not fit.

    """
    if not np.isfinite(theta):
        raise ParameterError(f'theta = {theta} is not a finite number')
    mechanism = mechanism_of(geometry)
    theta = mechanism.platform(Pose(0.0, 0.0, theta)).theta
    columns, rows = _shape(geometry, resolution)
    x = geometry.stroke[0] + resolution * (np.arange(columns) + 0.5)
    y = resolution * (np.arange(rows) + 0.5)
    row = pose_map(geometry, y, theta, characteristic_length)
    values = np.where(row.number > 0.0, row.index, np.nan)  # NaN > 0 is False
    values[np.isnan(row.lower)] = np.nan
    cells = np.full((rows, columns), UNREACHABLE, np.int8)
    inside = ~np.isnan(values)
    if inside.any():
        percent = np.rint(FULL * values[inside] / values[inside].max()).astype(np.int8)
        lower, upper = row.lower[inside, None], row.upper[inside, None]
        cells[inside] = np.where((lower <= x) & (x <= upper), percent[:, None], UNREACHABLE)
    corner = mechanism.head(Pose(geometry.stroke[0], 0.0, theta))
    return cells, corner._replace(theta=geometry.rail_angle)


def _shape(geometry: Geometry, resolution: float) -> tuple[int, int]:
    if not (np.isfinite(resolution) and resolution > 0.0):
        raise ParameterError(f'resolution = {resolution} m is not a positive length')
    extents = (geometry.stroke_length, geometry.link_length)
    if extents[0] * extents[1] / resolution ** 2 > MAX_CELLS:
        raise ParameterError(
            f'resolution = {resolution:g} m makes more than {MAX_CELLS} cells of '
            f'{extents[0]:g} m by {extents[1]:g} m')
    return tuple(max(1, int(np.ceil(extent / resolution - 1e-9))) for extent in extents)
