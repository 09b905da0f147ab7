"""Settings of a node in addition to those of its core objects, without ROS."""

from __future__ import annotations

from facade_manipulator.parameters import parameter, settings

OF_ROS = ('use_sim_time', 'start_type_description_service', 'qos_overrides')


@settings
class DriverSettings:
    """Settings of the driver node in addition to those of the controller."""

    simulate_drives: bool = parameter(
        'Whether the driver starts simulated drives on a virtual bus', default=False
    )
    configure_at_start: bool = parameter(
        'Whether the driver configures itself at its start, without powering the drives',
        default=False,
    )
    software_stop_timeout: float = parameter(
        'Silence of software_stop, once received, that stops the drives and forbids power',
        default=0.5,
        unit='s',
        minimum=0.05,
        maximum=10.0,
    )
    software_stop_topics: tuple[str, ...] = parameter(
        'Topics on which supervisors forbid power, one for each supervisor',
        default=('software_stop',),
    )


@settings
class SimulatorSettings:
    """Choice of the simulated world; the file of the scenario contains all values."""

    scenario: str = parameter(
        'Name of a scenario in config/scenarios, or path of a file', default='breeze'
    )
    viewer: bool = parameter("Whether MuJoCo's viewer shows the world", default=False)
