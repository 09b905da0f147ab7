"""What the head is to do on the wall in y and θ, which forces and how far it gives way."""

from __future__ import annotations

from typing import ClassVar

from facade_manipulator.parameters import parameter, settings


@settings
class ImpedanceSettings:
    """Desired force on the wall and how the axis y gives way to it."""

    approach_speed: ClassVar[float] = 0.004  # m/s, of the search: gentle even on a stiff wall
    speed: ClassVar[float] = 0.04  # m/s, highest of the offset

    enabled: bool = parameter(False, 'Whether the axis gives way to the wall')
    force: float = parameter(
        30.0, 'Desired force on the wall', unit='N', minimum=0.1, maximum=1000.0)
    stiffness: float = parameter(
        0.0, 'Stiffness towards the goal; 0 keeps the force whatever the offset',
        unit='N/m or N m/rad', minimum=0.0, maximum=1e6)
    contact_stiffness: float = parameter(
        3000.0, 'First guess of the stiffness of the contact, which is learnt', unit='N/m',
        minimum=1.0, maximum=1e6)
    brush_width: float = parameter(
        0.3, 'Width over which the head touches: makes a moment of the stiffness', unit='m',
        minimum=0.01, maximum=5.0)
    ramp_time: float = parameter(
        8.0, 'Time in which the force rises from a tenth to the desired one', unit='s',
        minimum=0.5, maximum=120.0)
    retreat: float = parameter(
        0.05, 'How far before the goal the head waits and returns to', unit='m', minimum=0.0,
        maximum=0.5)
    range: float = parameter(
        0.08, 'Furthest offset from the goal', unit='m', minimum=1e-4, maximum=0.5)
    most_yaw: float = parameter(
        0.087, 'Yaw of the gondola beyond which the force is reduced', unit='rad',
        minimum=0.01, maximum=1.0)
    most_sway: float = parameter(
        0.25, 'Sway of the gondola along the wall beyond which the force is reduced', unit='m',
        minimum=0.01, maximum=2.0)


@settings
class YawImpedanceSettings:
    """Desired moment on the wall and how the axis θ gives way to it."""

    speed: ClassVar[float] = 0.25  # rad/s, highest of the offset: 38 mm/s at the brush's ends

    enabled: bool = parameter(False, 'Whether the axis gives way to the wall')
    force: float = parameter(
        0.0, 'Desired moment on the wall', unit='N m', minimum=-100.0, maximum=100.0)
    stiffness: float = parameter(
        0.0, 'Stiffness towards the goal; 0 keeps the moment whatever the offset',
        unit='N m/rad', minimum=0.0, maximum=1e6)
    range: float = parameter(
        0.12, 'Furthest offset from the goal', unit='rad', minimum=1e-4, maximum=0.5)
