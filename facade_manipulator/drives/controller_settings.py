"""Settings of the cycle, its supervision and its time-outs."""

from __future__ import annotations

from facade_manipulator.errors import ParameterError
from facade_manipulator.parameters import parameter, settings
from facade_manipulator.timeouts import STEP_TIMEOUT

STATES_RATE = 100.0  # Hz, maximum: joint_states and the compensator need no higher rate


@settings
class ControllerSettings:
    """Settings of the cycle, its supervision and its time-outs."""

    rate: int = parameter(
        'Cycles per second, at least 2 / stream.stale_after; the period is a whole number of ms',
        default=100,
        unit='Hz',
        minimum=10,
        maximum=500,
    )
    heartbeat_timeout: float = parameter(
        'Silence after which master and drives consider each other lost',
        default=0.15,
        unit='s',
        minimum=0.1,
        maximum=1.0,
    )
    max_missed_cycles: int = parameter(
        'Cycles in a row, late or without SYNC or an answer of an axis, that stop all axes',
        default=3,
        minimum=1,
        maximum=10,
    )
    drive_lag: float = parameter(
        'Lag of the carriages behind the interpolated target',
        default=0.0,
        unit='s',
        minimum=0.0,
        maximum=0.5,
    )
    realtime_priority: int = parameter(
        'SCHED_FIFO priority of the control loop; 0 selects the normal scheduler',
        default=20,
        minimum=0,
        maximum=99,
    )
    cpu: int = parameter(
        'CPU of the control loop; -1 allows any CPU',
        default=-1,
        minimum=-1,
        maximum=1023,
    )

    # fixed: only tests have a reason to change them
    boot_timeout: float = 5.0  # s, longest time from reset to the boot-up message
    watchdog_timeout: float = (
        2.0  # s, silence of the node after which the drives ramp down
    )
    heartbeat_period: float = 0.05  # s, of the heartbeats of master and drives
    step_timeout: float = STEP_TIMEOUT  # s, longest time for one step of the drives
    ramp_timeout: float = 5.0  # s, longest time to come to rest on the path
    hold_cycles: int = 20  # from power-on until targets are followed

    def __post_init__(self) -> None:
        if 1000 % self.rate:
            raise ParameterError(
                f'rate = {self.rate} Hz is not a whole number of milliseconds per cycle; '
                'next: set 100, 125, 200, 250 or 500 Hz'
            )

    @property
    def period(self) -> float:
        """Return the time between two cycles [s]."""
        return 1.0 / self.rate
