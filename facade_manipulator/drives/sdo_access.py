"""
SDO access to one drive: identity, configuration, use by others, and power.

The methods of `SdoAccess` that use objects are generators, which yield while they wait for the
drive. These generators raise a DriveError that names the drive and its failure, or a BusError if
the bus is lost. `begin` starts a generator. Each answer of the drive resumes the generator at
once, because a drive has more than a hundred objects. The request also resumes the generator in
each turn of the control loop, for its time-outs.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from facade_manipulator.canopen import cob_ids, indices, nmt
from facade_manipulator.canopen.bus import CanBus, Frame
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.nmt import SupervisedHeartbeat
from facade_manipulator.canopen.sdo import SdoAbortError, SdoChannel, Steps
from facade_manipulator.canopen.sync import SyncProducer
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.configuration import (
    apply,
    check,
    check_identity,
    drive_writes,
    stops_without_master,
    unit_conflicts,
)
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.feedback import REST_SPEED
from facade_manipulator.drives.node_monitor import NodeMonitor
from facade_manipulator.drives.profile import DriveProfile
from facade_manipulator.drives.states import decode_state, POWERED_STATES, State
from facade_manipulator.errors import BusError, DriveError, DriveObjectError

IS_OPERATIONAL = 'is operational'  # use of a drive by another master, or by itself


class DriveSteps:
    """Sequence of steps for one drive, with the result or error of the sequence."""

    def __init__(self, steps: Steps[Any]) -> None:
        self.is_done = False
        self.error: Exception | None = None
        self._steps = steps
        self._result: Any = None

    def resume(self) -> None:
        """Run the steps until they wait again or end; `result` raises their error."""
        if self.is_done:
            return
        try:
            next(self._steps)
        except StopIteration as end:
            self._result = end.value
            self.is_done = True
        except Exception as error:
            # kept, because the other drives continue and may fail as well
            self.error = error
            self.is_done = True

    def result(self) -> Any:
        """Return the result of completed steps, or raise their error."""
        if self.error is not None:
            raise self.error
        return self._result

    def close(self) -> None:
        """Cancel the steps at the point where they wait."""
        self._steps.close()


class SdoAccess:
    """
    Objects of one drive, facts read from these objects, and the steps that use them.

    The total time of the answers to `begin` is limited, so that a slow drive fails like a silent
    drive. Raises a ParameterError if the profile contradicts the settings of the axis.
    """

    def __init__(
        self,
        title: str,
        axis: AxisSettings,
        profile: DriveProfile,
        node: NodeMonitor,
        controller: ControllerSettings,
    ) -> None:
        self.serial_number: int | None = None  #: as read at configure
        #: whether the drive, as it was configured, stops when this computer falls silent
        self.stops_without_master = False
        self.guard_time = 0.0  #: period in which a master may guard the drive [s]
        self.sync = SyncProducer()
        self._title = title
        self._axis = axis
        self._profile = profile
        self._node = node
        self._heartbeat_timeout_ms = 1e3 * controller.heartbeat_timeout
        self._writes = drive_writes(profile, axis, controller)
        self._objects: SdoChannel | None = None
        self._serials: dict[int, str] = {}
        self._steps: DriveSteps | None = None

    def connect(
        self, bus: CanBus, name: str, clock: Clock, serials: dict[int, str]
    ) -> None:
        """Use the objects of the drive on a bus; `serials` maps serial numbers to axis names."""
        node_id = self._axis.node_id
        self._objects = SdoChannel(bus, node_id, name, self._profile.eds, clock)
        self._serials = serials

    @property
    def objects(self) -> SdoChannel:
        """Return the objects of the drive; raise a BusError before a bus is open."""
        if self._objects is None:
            raise BusError(f'the bus of {self._title} is not open; next: configure')
        return self._objects

    # --- steps in progress

    def begin(self, steps: Steps[Any], deadline: float) -> DriveSteps:
        """Begin and return steps that send no request after a deadline [s]."""
        self.objects.limit_time(deadline)
        self._steps = DriveSteps(steps)
        self._steps.resume()
        return self._steps

    def receive(self, frame: Frame) -> None:
        """Receive an answer of the drive, and resume the waiting steps."""
        self.objects.receive(frame)
        self.resume()

    def resume(self) -> None:
        """Resume the steps in progress, if any."""
        if self._steps is not None:
            self._steps.resume()

    def end(self) -> None:
        """Cancel the steps in progress, if any."""
        if self._steps is not None:
            self._steps.close()
        self._steps = None

    # --- identity, configuration, power

    def identify(self) -> Steps[None]:
        """Check the identity of the drive, and store its serial number."""
        self.serial_number = yield from check_identity(
            self.objects, self._axis, self._serials
        )

    def configure(self) -> Steps[list[str]]:
        """Write and verify all objects; return notes about skipped objects and missing checks."""
        notes = yield from self.sync.end(self.objects)
        notes += yield from apply(self.objects, self._writes)
        rejected: list[str] = []
        problems = yield from self._unit_conflicts(rejected)
        for rejection in rejected:
            notes.append(
                f'{rejection}, so that this unit is not checked; next: compare the unit in the '
                'manual of the drive with its profile'
            )
        if problems:
            raise DriveObjectError(*problems)
        self.stops_without_master = yield from stops_without_master(
            self.objects, self._profile
        )
        if self.serial_number and not self._axis.serial_number:
            notes.append(
                f'{self._title} accepts any drive, so that swapped axes are not found; next: '
                f'set its serial_number to {self.serial_number}'
            )
        return notes

    def _unit_conflicts(self, rejected: list[str]) -> Steps[list[str]]:
        """
        Describe the drive units that differ from the axis settings.

        `rejected` takes the rejections of a drive that has a unit, but does not let it be read.
        """

        def read(index: int, subindex: int) -> Steps[int | None]:
            try:
                return (yield from self.objects.read_optional(index, subindex))
            except SdoAbortError as error:
                rejected.append(error.problem)
                return None

        conflicts = yield from unit_conflicts(read, self._axis)
        return [f'{self._title}: {problem}' for problem in conflicts]

    def prove(self) -> Steps[None]:
        """Check identity, units and objects without writing."""
        yield from self.identify()
        compared = yield from check(self.objects, self._writes)
        problems = yield from self._unit_conflicts([])
        problems += compared.problems.values()
        if problems:
            raise DriveObjectError(*problems)

    def use(self) -> Steps[str]:
        """
        Return how another program uses the drive, ``''`` if it does not.

        Another master may send seldom or never, but the state of the drive shows its presence. A
        drive that this driver has left behind monitors the driver's heartbeat (1016h), misses it,
        and has stopped.
        """
        state = yield from self._state()
        if state is None:
            return ''  # the drive is absent, or its reset shows the problem
        yield from self.sync.find(self.objects)
        guard_time = yield from self.objects.read_informative(indices.GUARD_TIME, 0)
        self.guard_time = 1e-3 * (guard_time or 0)

        speed = yield from self.objects.read_optional(
            indices.ACTUAL_VELOCITY, 0, signed=True
        )
        velocity = self._axis.si_per_unit.velocity * (speed or 0)
        if abs(velocity) > REST_SPEED:
            return f'{self._title} moves at {velocity:.3g} m/s'

        watched = yield from self.objects.read_optional(
            *self._profile.heartbeat_consumer
        )
        node, timeout = SupervisedHeartbeat.decode(watched or 0)
        misses_us = (
            node == cob_ids.MASTER_NODE_ID and 0 < timeout <= self._heartbeat_timeout_ms
        )
        has_stopped = misses_us and state is State.QUICK_STOP_ACTIVE
        if state in POWERED_STATES and not has_stopped:
            return f'{self._title} has power ({state.value})'
        if self._node.state == 'OPERATIONAL' and not misses_us:
            starts_itself = yield from self._starts_itself()
            if not starts_itself:
                return f'{self._title} {IS_OPERATIONAL}'
        return ''

    def _starts_itself(self) -> Steps[bool]:
        """Return whether the drive becomes operational after boot-up without a command."""
        startup = yield from self.objects.read_informative(indices.NMT_STARTUP, 0)
        is_stored = startup is not None and not startup & nmt.WAITS_FOR_START
        return self._profile.quirks.starts_itself or is_stored

    def switch_off(self) -> Steps[State | None]:
        """Switch the drive off; return its state, or None without an answer."""
        # a drive that does not answer is asked once more
        with suppress(DriveError, BusError):
            # disable voltage
            yield from self.objects.write(indices.CONTROLWORD, 0, bytes(2))
        return (yield from self._state())

    def _state(self) -> Steps[State | None]:
        """Return the state of the drive, or None without a timely and valid answer."""
        try:
            word = yield from self.objects.read_number(indices.STATUSWORD)
        except (DriveError, BusError):
            return None
        return decode_state(word)
