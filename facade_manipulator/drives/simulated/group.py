"""The drives that an axis configuration asks for, simulated: parked at home, of that identity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

from facade_manipulator.drives.cia402 import AxisScale, AxisSettings, load_profile
from facade_manipulator.drives.simulated.drive import Identity, SimulatedDrive
from facade_manipulator.drives.simulated.motor import SimulationSettings

REVISION = 1


def simulated_drives(
    axes: Sequence[AxisSettings], settings: SimulationSettings | None = None
) -> list[SimulatedDrive]:
    """
    Make one drive for each axis, with its carriage at the axis's home position.

    An identity that the axis leaves open is made up: the serial number is then the node id.

    Parameters
    ----------
    axes : sequence of AxisSettings
    settings : SimulationSettings, optional
        Of all drives, but for the start position.

    """
    settings = settings or SimulationSettings()
    return [
        SimulatedDrive(
            axis.node_id, load_profile(axis.profile), _scale(axis),
            Identity(axis.vendor_id, axis.product_code, REVISION,
                     axis.serial_number or axis.node_id),
            replace(settings, start_position=axis.home_position))
        for axis in axes]


def _scale(axis: AxisSettings) -> AxisScale:
    return AxisScale(**{item.name: getattr(axis, item.name) for item in fields(AxisScale)})
