"""
Time-outs for the end of the driver; each level must wait longer than the level below it.

The end of the driver consists of levels. Each level waits for the level below it, and ends it by
force after its own time-out. A shorter time-out would interrupt an orderly stop. Therefore each
value is computed from the value that it must exceed, from the inside to the outside:

    answer of a drive < attempts of one object < request `close` < end of the loop's process
    < end as seen by the driver node < end as seen by launch, systemd and demo

Times are in seconds and apply to brakes that stop at once. Up to the driver node, `braking_time`
is added to these times.
"""

# --- a drive

RESPONSE_TIMEOUT = 0.3  # answer to an SDO request; drives answer in up to 0.2 s
ATTEMPTS = 3  # of a transfer, after lost answers
# for the few objects that are read from a drive that may be absent; more than all attempts
ASKING_TIMEOUT = (ATTEMPTS + 1) * RESPONSE_TIMEOUT
STEP_TIMEOUT = 1.0  # one step of the drives, such as to switch on
STOP_AND_CUT = 2  # steps: a drive that still moves is stopped before it loses its power

# --- the request `close` of the control loop

ORDERLY_STOP_TIMEOUT = 3.0  # a ramp to rest, and power off step by step
# then a quick stop and power off by PDO, and by SDO: a last request may just have been sent
CLOSE_REQUEST_TIMEOUT = (
    ORDERLY_STOP_TIMEOUT
    + STOP_AND_CUT * STEP_TIMEOUT
    + ASKING_TIMEOUT
    + RESPONSE_TIMEOUT
)

# --- the processes

# after which the kernel ends the loop's process: also the simulated drives end
END_TIMEOUT = CLOSE_REQUEST_TIMEOUT + 0.5
# after which the driver node kills the loop's process: also its log is written
CLOSE_TIMEOUT = END_TIMEOUT + 1.0
SLOWEST_BRAKING = 3.0  # longest quick stop for which launch, systemd and demo wait
# after which launch, systemd and demo kill the driver node: also its ROS context ends
DRIVER_TIMEOUT = CLOSE_TIMEOUT + STOP_AND_CUT * SLOWEST_BRAKING + 1.0


def braking_time(longest_stop: float) -> float:
    """Return the additional time that long quick stops require at the end of the driver [s]."""
    return STOP_AND_CUT * longest_stop
