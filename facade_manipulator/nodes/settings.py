"""Settings of the nodes, beside those of the core objects."""

from __future__ import annotations

from facade_manipulator.parameters import parameter, settings


@settings
class DriverSettings:
    """Settings of the driver node, beside those of the controller."""

    simulate_drives: bool = parameter(
        'Whether the driver starts simulated drives on its own virtual bus', default=False)
    configure_at_start: bool = parameter(
        'Whether the driver configures itself when it starts; it never powers the drives',
        default=False)
    software_stop_timeout: float = parameter(
        'Silence of software_stop, once received, that stops the drives and forbids power',
        default=0.5, unit='s', minimum=0.05, maximum=10.0)
    software_stop_topics: tuple[str, ...] = parameter(
        'Topics on which supervisors forbid power, one for each of them',
        default=('software_stop',))


@settings
class RateSettings:
    """Rate of the compensator."""

    rate: float = parameter(
        'Rate of corrected poses', default=100.0, unit='Hz', minimum=10.0, maximum=1000.0)
