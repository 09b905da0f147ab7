"""
Publish setpoints a thousand times a second of which one in twenty is good, until ended.

The good ones go to and fro from the home position by up to `REACH`; of the bad ones those that
only their time betrays lie `NEAR_BY` behind it.
"""

from __future__ import annotations

import math
import os
import random
import signal
import time

from builtin_interfaces.msg import Time
import rclpy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from facade_manipulator import interfaces
from facade_manipulator.ros.conversions import stamp
from facade_manipulator.ros.interfaces import publisher

HOME = (-0.1, 0.1, 0.0)
NAMES = ('q1', 'q2', 'q3')
PERIOD, GOOD_ONE_IN, TELL_EVERY = 0.001, 20, 500
REACH, FREQUENCY, AHEAD = 0.04, 0.5, 0.06
NEAR_BY, FAR_AWAY = -0.04, -0.3
NOTHING = (math.nan, math.inf, -math.inf)


def good(now: float, begin: float) -> JointState:
    """Make the setpoint of a smooth course."""
    angle = 2.0 * math.pi * FREQUENCY * (now - begin)
    speed = REACH * math.pi * FREQUENCY * math.sin(angle)
    return setpoint(now, 0.5 * REACH * (1.0 - math.cos(angle)), (speed,) * 3)


def setpoint(when: float, shift: float, velocity=(0.0,) * 3, names=NAMES) -> JointState:
    """Make a setpoint with all carriages shifted from home."""
    message = JointState(
        name=names, position=[q + shift for q in HOME][:len(names)], velocity=velocity)
    message.header.stamp = stamp(when)
    return message


def bad(rng: random.Random, now: float) -> list[JointState]:
    """Make setpoints that must not be followed, each for another reason."""
    nothing = rng.choice(NOTHING)
    lame = [0.0, 0.0, 0.0]
    lame[rng.randrange(3)] = nothing
    never = setpoint(now, NEAR_BY)
    never.header.stamp = rng.choice((
        Time(sec=2**31 - 1, nanosec=2**32 - 1), Time(sec=-2**31), Time()))
    return [
        setpoint(now - rng.uniform(1.0, 100.0), NEAR_BY),  # stale
        setpoint(now + rng.uniform(2.0, 100.0), NEAR_BY),  # in the future
        never,
        setpoint(now, nothing),
        setpoint(now, NEAR_BY, lame),
        setpoint(now - 0.1, FAR_AWAY),  # unordered
        setpoint(now, FAR_AWAY),  # a jump
        setpoint(now, 0.9),  # beyond the rail
        setpoint(now, NEAR_BY, names=('q1', 'q2')),
        setpoint(now, NEAR_BY, names=('q1', 'q2', 'q2')),
        setpoint(now, NEAR_BY, (0.0,) * 7),
        JointState(),
    ]


def main() -> None:
    """Publish, and say now and then how many there were."""
    os.nice(19)  # on one slow processor: as many as the driver can bear
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('stranger')
    sender = publisher(node, interfaces.JOINT_SETPOINTS)
    while not sender.get_subscription_count():
        time.sleep(0.01)
    rng, number, begin = random.Random(0), 0, time.time()
    while True:
        now = time.time()
        if number % GOOD_ONE_IN:
            sender.publish(rng.choice(bad(rng, now + AHEAD)))
        else:
            sender.publish(good(now + AHEAD, begin + AHEAD))
        number += 1
        if number % TELL_EVERY == 0:
            print(f'{number} setpoints in {time.time() - begin:.2f} s', flush=True)
        time.sleep(max(0.0, begin + number * PERIOD - time.time()))


if __name__ == '__main__':
    main()
