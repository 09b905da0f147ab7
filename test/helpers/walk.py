"""
A walk of a thousand things that may happen to the driver, with what must hold all the while.

Hypothesis chooses requests, faults, what happens on the bus, steps of the system clock, streams of
setpoints and changes of limits; the drives and the control loop live in a time of their own
(`virtual_world`). What is checked is what somebody sees who shares nothing with the master but the
bus, and the drives themselves.
"""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future
import math
import re

from command_watch import COMMANDS, CYCLIC_POSITION, differences, ENABLED
from hypothesis import strategies as st
from hypothesis.stateful import rule, RuleBasedStateMachine
from virtual_world import World

from facade_manipulator.drives.cia402.controller_state import ControllerState
from facade_manipulator.drives.cia402.settings import AXIS_NAMES
from facade_manipulator.drives.cia402.states import State
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.setpoints import Setpoint

REQUESTS = ('configure', 'cleanup', 'activate', 'deactivate', 'home', 'halt', 'clear_faults',
            'self_test')
POWERING = ('activate', 'home')
LIFECYCLE = {'activate': True, 'deactivate': False, 'cleanup': False}  # is the node active then?
ANSWER_BOUND = 70.0  # s: the time-out of homing is 60 s
STEPS_TO_ACTIVE = 16
MOST_STEPS = 5  # cycles in which all three are told to stop when one has left operation
COUNT = 1.0 / 430_000  # m, to which targets are rounded
ROUNDING = (1.0, 2.0, 4.0)  # counts, in the first, second and third difference
LEAD = 0.04  # s, by which setpoints are ahead
LEAST_GAP = 0.012  # m, of the 20 that are commanded, between the carriages as measured
FAULT_CODES = (0x8611, 0x7380, 0x2310, 0x8130, 0x3210, 0xFF02, 0x7392)
NMT_COMMANDS = (1, 2, 128, 129, 130)
axes = st.integers(0, 2)


class CommandLog:
    """What the master commands, frame by frame."""

    def __init__(self, period: float) -> None:
        self._period = period
        self._triple: dict[int, float] = {}
        self.may_enable = self.is_late = False
        self.greatest = MotionLimits()
        self.positions: deque[tuple[float, ...]] = deque(maxlen=4)
        self.forget()

    def forget(self) -> None:
        """Begin again: nothing is commanded."""
        self._enabled = [False] * 3
        self.positions.clear()
        self._triple.clear()

    def take(self, cob_id: int, data: bytes, scales, check) -> None:
        """Check a command."""
        number = cob_id - 0x201
        controlword, mode, counts = COMMANDS.unpack(data)
        enabled = controlword & 0x0F == ENABLED
        if enabled and not self._enabled[number]:
            assert self.may_enable, f'{AXIS_NAMES[number]} is enabled though nobody asked'
        self._enabled[number] = enabled
        if not enabled or mode != CYCLIC_POSITION:
            self.positions.clear()
            self._triple.clear()
            return
        self._triple[number] = scales[number].to_metres(counts)
        if len(self._triple) == 3:
            self.positions.append(tuple(self._triple[n] for n in range(3)))
            self._triple.clear()
            check(self.positions[-1])
            if not self.is_late:  # differences are of commands that are a period apart
                self._check_differences()

    def _check_differences(self) -> None:
        limits = self.greatest
        found = differences(self.positions, self._period)
        for power, (value, bound, counts) in enumerate(zip(
                found, (limits.speed, limits.acceleration, limits.jerk), ROUNDING, strict=True),
                start=1):
            tolerance = counts * COUNT / self._period ** power
            assert value <= 1.001 * bound + tolerance, f'{power}. difference {value}, {bound}'


class Walk(RuleBasedStateMachine):
    """Whatever happens, the machine is safe, and the next step that is named works."""

    def __init__(self) -> None:
        super().__init__()
        self.world = World()
        self.log = CommandLog(self.world.settings.period)
        self.jobs: list[tuple[str, Future, float]] = []
        self.is_active = False
        self.course = (0.0, 1.0)
        self.cycle = 0
        self.next_cycle = self.next_silence = 0.0
        self.base: tuple[float, ...] | None = None
        self.out_of_operation = 0.0
        self.world.run(0.2)

    # --- what happens

    @rule(name=st.sampled_from(REQUESTS), seconds=st.floats(0.0, 0.5))
    def ask(self, name: str, seconds: float) -> None:
        """An operator asks for something, and does not wait for the answer."""
        self._request(name)
        self._run(seconds)

    @rule(seconds=st.floats(0.0, 2.0))
    def wait(self, seconds: float) -> None:
        """Nothing happens."""
        self._run(seconds)

    @rule(steps=st.integers(1, 6))
    def do_as_told(self, steps: int) -> None:
        """An operator takes the next steps."""
        for _ in range(steps):
            if self.state is ControllerState.ACTIVE:
                break
            self._take_next_step()

    @rule(cause=st.sampled_from(('software_stop', 'the node ends')))
    def stop(self, cause: str) -> None:
        """Somebody stops the drives."""
        self.world.controller.stop(cause)
        self._run(0.02)

    @rule(seconds=st.floats(0.0, 0.3))
    def stall(self, seconds: float) -> None:
        """The control loop stands still; the drives hold, and the next target is what is left."""
        self.log.is_late = True
        self.world.pass_time(seconds)
        self._run(0.03)
        self.log.is_late = False
        self.log.positions.clear()

    @rule(amplitude=st.floats(-0.12, 0.12), rate=st.floats(0.2, 6.0))
    def follow(self, amplitude: float, rate: float) -> None:
        """A stream of setpoints goes to and fro."""
        self.course, self.base = (amplitude, rate), None

    @rule(position=st.tuples(*[st.floats(-0.6, 0.6) | st.just(math.nan)] * 3),
          velocity=st.tuples(*[st.floats(-9.0, 9.0) | st.just(math.inf)] * 3),
          ahead=st.floats(-0.3, 1.5))
    def send_anything(self, position, velocity, ahead: float) -> None:
        """A setpoint comes from anybody."""
        self._send(Setpoint(self.world.time.time() + ahead, position, velocity))
        self._run(0.02)

    @rule(speed=st.floats(0.05, 0.5), acceleration=st.floats(0.5, 3.0))
    def change_limits(self, speed: float, acceleration: float) -> None:
        """An operator changes the limits."""
        self.world.follower.change_limits(MotionLimits(speed, acceleration))

    @rule(seconds=st.sampled_from((-30.0, -5.0, -0.3, -0.02, 0.02, 0.3, 5.0, 30.0)))
    def set_clock(self, seconds: float) -> None:
        """The system clock is set."""
        self.world.time.offset += seconds
        self._run(0.05)

    @rule(axis=axes, code=st.sampled_from(FAULT_CODES), stays=st.booleans())
    def fault(self, axis: int, code: int, stays: bool) -> None:
        """A drive reports a fault."""
        self.world.drives[axis].inject_fault(code, persistent=stays)
        self._run(0.05)

    @rule(axis=axes, slip=st.floats(-0.03, 0.03))
    def lose_position(self, axis: int, slip: float) -> None:
        """A drive loses its position."""
        self.world.drives[axis].lose_position(slip)
        self._run(0.05)

    @rule(axis=axes)
    def reboot(self, axis: int) -> None:
        """A drive restarts."""
        self.world.drives[axis].reboot()
        self._run(0.05)

    @rule(axis=axes, silent=st.booleans())
    def silence(self, axis: int, silent: bool) -> None:
        """A drive falls silent, or is heard again."""
        self.world.drives[axis].is_silent = silent
        self._run(0.05)

    @rule(axis=axes)
    def open_torque_off(self, axis: int) -> None:
        """The safety chain opens."""
        self.world.drives[axis].open_safe_torque_off()
        self._run(0.05)

    @rule()
    def mend(self) -> None:
        """Somebody removes the causes."""
        self._heal()

    @rule(down=st.booleans(), seconds=st.floats(0.0, 3.0))
    def switch_bus(self, down: bool, seconds: float) -> None:
        """The interface goes down or comes up."""
        self.world.bus_is_down = down
        self._run(seconds)

    @rule(command=st.sampled_from(NMT_COMMANDS), node=st.integers(0, 3))
    def command_network(self, command: int, node: int) -> None:
        """Another master commands a node."""
        self.world.forge(0, bytes([command, node]))
        self._run(0.05)

    # --- what must hold

    def _check(self) -> None:
        """Check what is seen after each turn of the control loop."""
        world = self.world
        self.log.may_enable = any(name in POWERING for name, job, _ in self.jobs)
        while world.sent:
            _, cob_id, data = world.sent.popleft()
            if 0x201 <= cob_id <= 0x203:
                self.log.take(cob_id, data, self.scales, world.guard)
        self._check_power()
        self._check_answers()
        if world.time.now >= self.next_cycle:
            self.next_cycle = world.time.now + world.settings.period
            self._stream()

    def _check_power(self) -> None:
        state, snapshot = self.state, self.world.controller.snapshot()
        enabled = [drive.state is State.OPERATION_ENABLED for drive in self.world.drives]
        if state in (ControllerState.BUS_LOST, ControllerState.UNCONFIGURED):
            self.log.forget()
        if state is ControllerState.INACTIVE:
            assert not any(enabled), 'powered, though the state says inactive'
        if not (state is ControllerState.ACTIVE and not all(enabled)):
            self.out_of_operation = self.world.time.now
        assert self.world.time.now - self.out_of_operation <= (
            MOST_STEPS * self.world.settings.period + 0.15), 'one has left operation, and not all'
        if state is ControllerState.ACTIVE:
            q1, q2, q3 = (axis.position for axis in snapshot.axes)
            assert min(q3 - q1, q2 - q3) > LEAST_GAP, (q1, q2, q3)

    def _check_answers(self) -> None:
        for name, job, since in self.jobs:
            assert job.done() or self.world.time.now - since < ANSWER_BOUND, f'{name}: no answer'
            if job.done() and job.exception() is None:
                self.is_active = LIFECYCLE.get(name, self.is_active)
        self.jobs = [one for one in self.jobs if not one[1].done()]
        self.is_active &= self.state.is_active
        assert self.jobs or self.is_active == (self.state.is_active), (
            f'{self.state}, and the node is {"active" if self.is_active else "inactive"}')

    def teardown(self) -> None:
        """However it ended: the steps that are named lead to drives that follow setpoints."""
        try:
            self._heal()
            self._run(4.0)
            for _ in range(STEPS_TO_ACTIVE):
                if self.state is ControllerState.ACTIVE:
                    break
                self._take_next_step()
            snapshot = self.world.controller.snapshot()
            assert self.state is ControllerState.ACTIVE, (
                self.state, snapshot.causes, snapshot.next_step, self.told)
        finally:
            self.world.close()

    # --- how

    told = ''

    @property
    def state(self) -> ControllerState:
        """What the controller says that it does."""
        return self.world.controller.snapshot().state

    @property
    def scales(self):
        """Counts and metres of the axes."""
        return self.world.controller._session.axes

    def _request(self, name: str) -> Future:
        job = self.world.controller.request(name)
        self.jobs.append((name, job, self.world.time.now))
        return job

    def _run(self, seconds: float) -> None:
        self.world.run(seconds, self._check)

    def _finish(self, name: str) -> str:
        """Ask and wait; return the answer, or why there is none."""
        try:
            return str(self.world.finish(self._request(name), ANSWER_BOUND, self._check))
        except ManipulatorError as error:
            return str(error)
        finally:
            self._check()

    def _take_next_step(self) -> None:
        """Do what the last message or the diagnostics name."""
        snapshot = self.world.controller.snapshot()
        words = f'{self.told} {snapshot.next_step}'
        steps = self._named(words)
        self.told = ''
        if wait := re.search(r'the next reset is possible in (\d+) s', words):
            self._run(float(wait[1]) + 1.0)
        if not steps:
            self._run(0.5)
        for step in steps:
            self.told = self._finish(step)

    def _named(self, words: str) -> tuple[str, ...]:
        if self.state is ControllerState.UNCONFIGURED:
            return ('configure',)
        if self.state is ControllerState.INACTIVE:
            return ('home',) if self.world.controller.snapshot().unhomed else ('activate',)
        if self.state is ControllerState.HALTED:
            return ('activate',)
        if self.state is not ControllerState.STOPPED:
            return ()
        return ('cleanup', 'configure') if 'cleanup' in words else ('clear_faults',)

    def _heal(self) -> None:
        self.world.bus_is_down = False
        for drive in self.world.drives:
            drive.is_silent = False
            drive.remove_cause()

    def _stream(self) -> None:
        """Send the setpoint of this cycle, as the node does while the drives follow."""
        if self.state is not ControllerState.ACTIVE:
            self.base = None
            return
        if self.base is None:
            self.base, self.cycle = self.world.follower.motion.position, 0
        amplitude, rate = self.course
        self.cycle += 1
        time = self.cycle * self.world.settings.period
        offset = 0.5 * amplitude * (1.0 - math.cos(rate * time))
        speed = 0.5 * amplitude * rate * math.sin(rate * time)
        shares = (1.0, 0.9, 0.95)
        self._send(Setpoint(
            self.world.time.time() + LEAD,
            tuple(q + share * offset for q, share in zip(self.base, shares, strict=True)),
            tuple(share * speed for share in shares)))

    def _send(self, setpoint: Setpoint) -> None:
        try:
            self.world.stream(setpoint)
        except ManipulatorError:
            return  # what is rejected moves nothing
