"""The time before a stop once more, on simulated drives and at the pace of then."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
import re
from tempfile import TemporaryDirectory
import time
from typing import Any, NamedTuple

from facade_manipulator.blackbox import RecordedRun
from facade_manipulator.diagnostics import AXIS
from facade_manipulator.diagnostics import OPERATION as OPERATION_TABLE
from facade_manipulator.drives import cia402
from facade_manipulator.drives.canopen import BusSettings, Condition, condition_of, ERROR_FRAME
from facade_manipulator.drives.controller import ControllerSettings, ControllerState
from facade_manipulator.errors import (
    DriveError,
    ManipulatorError,
    ParameterError,
    RecordError,
    without_numbers,
)
from facade_manipulator.lab.drives import start_simulator
from facade_manipulator.loop import LoopClient, LoopSetup
from facade_manipulator.motion import MotionLimits, Setpoint, StreamSettings
from facade_manipulator.parameters import settings_from
from facade_manipulator.tools.replay.parameters import geometry_of
from facade_manipulator.tools.replay.poses import recorded_setpoints
from facade_manipulator.tools.replay.timeline import OPERATION, STATE, statuses

PERIOD = 0.01  # s
LEAD = 0.06  # s until the replay begins
HOME_HERE = 37, 35  # homing methods: the present position is home, 35 as older drives have it
REQUEST_TIMEOUT = 30.0  # s
AFTERMATH = 2.0  # s: how long after the recording a stop may still come
CAUSE = OPERATION_TABLE.key('cause')
ERROR_CODE, HEARTBEAT_AGE = map(AXIS.key, ('error code', 'heartbeat age [s]'))
SILENCE = 0.3  # s without a word of a drive while the others go on
HEARTBEAT_TIMEOUT = 0.5  # s: no carriage depends on it here, and no computer is in time for sure
STOPPED = frozenset({ControllerState.STOPPED.value, ControllerState.BUS_LOST.value,
                     ControllerState.LOST.value})
EMERGENCY, TPDO1, HEARTBEAT = 0x080, 0x180, 0x700  # COB-ID less the node id
LOST = ControllerState.BUS_LOST.value
BUS_OFF = ERROR_FRAME | 0x040, bytes(8)  # linux/can/error.h: ends the bus as any loss does
BUS = 0  # the drive through which what concerns all of them comes
MASTER_IS_MISSING = 0x8130  # a consequence of a stop, never its cause


class DriveFault(NamedTuple):
    """What a drive did at a time [s], and how a simulated drive is made to do it."""

    time: float
    axis: int
    description: str
    method: str
    arguments: tuple[Any, ...] = ()
    bus: bool = False  #: whether all drives are concerned

    @property
    def who(self) -> str:
        """Return the name of the axis, or that of the bus."""
        return 'bus:' if self.bus else cia402.AXIS_NAMES[self.axis]


class Stop(NamedTuple):
    """When [s] and why the drives stopped; the time is that of the recording."""

    time: float
    cause: str
    has_lost_bus: bool = False

    @property
    def kind(self) -> str:
        """What is the same of two stops: which interface lost its bus how is its own affair."""
        return 'bus lost' if self.has_lost_bus else without_numbers(self.cause)


class StopReplay(NamedTuple):
    """How the recorded stop and the replayed one compare; None where nothing stopped."""

    recorded: Stop | None
    replayed: Stop | None
    faults: list[DriveFault]  #: what the simulated drives were made to do
    rejections: list[str]  #: setpoints that the driver rejected

    @property
    def is_alike(self) -> bool:
        """Return whether both stopped for the same cause, its numbers apart, or neither did."""
        ours, theirs = (stop and stop.kind for stop in (self.replayed, self.recorded))
        return ours == theirs


def recorded_stop(run: RecordedRun) -> Stop | None:
    """Return the first stop that the driver's diagnostics name within the recording."""
    moved = False
    for stamp, status, values in statuses(run):
        if status.name.endswith(OPERATION):
            if moved and values.get(STATE) in STOPPED:
                return Stop(stamp, values.get(CAUSE, status.message), values[STATE] == LOST)
            moved |= values.get(STATE) not in STOPPED
    return None


def drive_faults(run: RecordedRun) -> list[DriveFault]:
    """
    Return what drives did that a drive in order does not do, in the order of time.

    Read from the frames on the bus; without them from the driver's diagnostics.
    """
    nodes = [run.parameters['driver'][f'{name}.node_id'] for name in cia402.AXIS_NAMES]
    found = [*(_faults_on_bus(run, nodes) if run.topics['can_frames'] else
               _faults_in_diagnostics(run))]
    stop = recorded_stop(run)
    if stop is not None and stop.has_lost_bus and not any(fault.bus for fault in found):
        found.append(DriveFault(  # an interface that is down or gone sends no error frame
            stop.time, BUS, 'the interface is lost', 'send_message', BUS_OFF, bus=True))
    first: dict[tuple[int, str], DriveFault] = {}
    for fault in sorted(found, key=lambda fault: fault.time):
        first.setdefault((fault.axis, fault.description), fault)
    return list(first.values())


def _faults_on_bus(run: RecordedRun, nodes: list[int]) -> Iterator[DriveFault]:
    yield from _error_frames(run)
    words = dict.fromkeys(range(len(nodes)), run.begin)
    beats: dict[int, float] = {}
    for stamp, axis, kind, data in _frames_of_drives(run, nodes):
        if kind == EMERGENCY:
            yield from _errors(stamp, axis, int.from_bytes(data[:2], 'little'))
        elif kind == HEARTBEAT and data == b'\0':
            yield DriveFault(stamp, axis, 'restarts', 'reboot')
            for received in (words, beats):  # what it does not say afterwards is a consequence
                received.pop(axis, None)
        else:
            words[axis] = stamp
            if kind == HEARTBEAT:
                beats[axis] = stamp
    silent = _silent(words)
    yield from (_silence(words[axis], axis) for axis in silent)
    yield from (DriveFault(beats[axis], axis, 'sends no heartbeat', 'stop_heartbeat')
                for axis in _silent(beats) - silent)


def _error_frames(run: RecordedRun) -> Iterator[DriveFault]:
    """Yield what the controller of the interface said of the bus: the driver receives it again."""
    for stamp, frame in run.topics['can_frames']:
        data = bytes(frame.data[:frame.dlc])
        condition = condition_of(frame.id, data) if frame.is_error and stamp >= run.begin else None
        if condition not in (None, Condition.ACTIVE):
            yield DriveFault(stamp, BUS, f'the controller is {condition.name.lower()}',
                             'send_message', (ERROR_FRAME | frame.id, data), bus=True)


def _silent(words: dict[int, float]) -> set[int]:
    """Return whose last word [s] is long past while the others go on."""
    newest = max(words.values(), default=0.0)
    return {axis for axis, word in words.items() if newest - word > SILENCE}


def _frames_of_drives(
    run: RecordedRun, nodes: list[int]
) -> Iterator[tuple[float, int, int, bytes]]:
    """Yield time, axis, COB-ID less the node id, and data of what the drives say."""
    for stamp, frame in run.topics['can_frames']:
        node = frame.id & 0x7F
        kind = frame.id - node
        if (not frame.is_error and node in nodes and kind in (TPDO1, HEARTBEAT, EMERGENCY)
                and stamp >= run.begin):
            yield stamp, nodes.index(node), kind, bytes(frame.data[:frame.dlc])


def _faults_in_diagnostics(run: RecordedRun) -> Iterator[DriveFault]:
    for stamp, status, values in statuses(run):
        name = status.name.rpartition('driver: ')[2]
        if name not in cia402.AXIS_NAMES:
            continue
        axis = cia402.AXIS_NAMES.index(name)
        if code := re.fullmatch(r'([0-9A-F]+)h', values.get(ERROR_CODE, '')):
            yield from _errors(stamp, axis, int(code[1], 16))
        age = re.fullmatch(r'[\d.]+', values.get(HEARTBEAT_AGE, ''))
        if age and float(age[0]) > SILENCE:
            yield _silence(stamp - float(age[0]), axis)


def _errors(time: float, axis: int, code: int) -> Iterator[DriveFault]:
    if code not in (0, MASTER_IS_MISSING):
        yield DriveFault(time, axis, f'reports error {code:04X}h', 'inject_fault', (code,))


def _silence(time: float, axis: int) -> DriveFault:
    return DriveFault(time, axis, 'falls silent', '__setattr__', ('is_silent', True))


def replay_stop(
    run: RecordedRun, duration: float,
    setpoints: Sequence[tuple[float, Setpoint]] | None = None,
) -> StopReplay:
    """
    Let simulated drives follow the recorded setpoints, or others, and fail as those did.

    Takes as long as it took then: the control loop is the real one, in its own process. It begins
    a duration [s] before the stop, or the end of the recording. Raises a RecordError if there is
    no setpoint in that time, a ManipulatorError if the simulated drives cannot be brought there.
    """
    stop = recorded_stop(run)
    begin = (stop.time if stop else run.end) - duration
    setpoints = [one for one in (recorded_setpoints(run) if setpoints is None else setpoints)
                 if one[0] >= begin]
    if not setpoints:
        raise RecordError(f'no joint_setpoints within {duration:g} s before the stop')
    begin, first = setpoints[0]
    rejections: list[str] = []
    with TemporaryDirectory() as folder:
        for name, content in run.files.items():
            (Path(folder) / Path(name).name).write_bytes(content)
        setup = _setup(run, first.position, Path(folder))
        faults = [fault for fault in drive_faults(run) if fault.time >= begin]
        loop = LoopClient(setup, lambda _, message: rejections.append(message))
        try:
            _power_on(loop)
            replayed = _play(
                loop, begin, _actions(run, loop, setpoints, faults), run.end + AFTERMATH)
        finally:
            with suppress(DriveError):  # recorded faults may leave simulated drives silent
                loop.close()
    return StopReplay(stop, replayed, faults, rejections)


def _setup(run: RecordedRun, start: Sequence[float], folder: Path) -> LoopSetup:
    """Return the recorded settings, for drives that are at home where the replay begins."""
    geometry, values = geometry_of(run, 'driver'), run.parameters['driver']
    controller = replace(settings_from(ControllerSettings, values, 'controller'),
                         heartbeat_timeout=HEARTBEAT_TIMEOUT)
    return LoopSetup(
        geometry, controller, drives_at_home(run, start, folder), BusSettings(interface='virtual'),
        settings_from(StreamSettings, values, 'stream'),
        settings_from(MotionLimits, values, 'limits'), simulate=start_simulator)


def drives_at_home(
    run: RecordedRun, start: Sequence[float], folder: Path
) -> tuple[cia402.AxisSettings, ...]:
    """
    Return the recorded settings of the axes, whose home is where they start [m].

    A drive profile that is missing on this computer is taken from the folder.
    """
    defaults = cia402.axis_defaults(geometry_of(run, 'driver').stroke)
    axes = (settings_from(cia402.AxisSettings, run.parameters['driver'], name, **own)
            for name, own in defaults.items())
    return tuple(_at_home(axis, position, folder)
                 for axis, position in zip(axes, start, strict=True))


def _at_home(axis: cia402.AxisSettings, position: float, folder: Path) -> cia402.AxisSettings:
    carried = folder / f'{Path(axis.profile).stem}.yaml'
    try:
        profile = cia402.load_profile(axis.profile)
    except ParameterError:
        if not carried.exists():
            raise
        axis = replace(axis, profile=str(carried))
        profile = cia402.load_profile(axis.profile)
    method = next((method for method in HOME_HERE if method in profile.homing_methods),
                  axis.homing_method)
    return replace(axis, home_position=position, homing_method=method)


def _actions(
    run: RecordedRun, loop: LoopClient, setpoints: list[tuple[float, Setpoint]],
    faults: list[DriveFault],
) -> list[tuple[float, Callable[[float], None]]]:
    """Return what is to be done at which time of the recording; each receives the time's shift."""
    actions: list[tuple[float, Callable[[float], None]]] = [
        (time, _sending(loop, one)) for time, one in setpoints]
    actions += [(fault.time, _disturbing(loop, fault)) for fault in faults]
    actions += [
        (one.time, lambda _: loop.stop('software_stop was set'))
        for one in run.topics['software_stop']
        if one.message.data and one.time >= setpoints[0][0]]
    return sorted(actions, key=lambda action: action[0])


def _sending(loop: LoopClient, one: Setpoint) -> Callable[[float], None]:
    return lambda shift: loop.send_setpoint(one._replace(time=one.time + shift))


def _disturbing(loop: LoopClient, fault: DriveFault) -> Callable[[float], None]:
    return lambda _: loop.disturb(fault.axis, fault.method, *fault.arguments)


def _power_on(loop: LoopClient) -> None:
    for request in ('configure', 'home', 'activate'):
        job, end = loop.request(request), time.monotonic() + REQUEST_TIMEOUT
        while not job.done():
            if time.monotonic() > end:
                raise ManipulatorError(
                    f'the simulated drives were not ready within {REQUEST_TIMEOUT:g} s')
            loop.feed()
            time.sleep(PERIOD)
        job.result()


def _play(
    loop: LoopClient, begin: float, actions: list[tuple[float, Callable[[float], None]]],
    end: float,
) -> Stop | None:
    """Do the actions at their time; return when and why the drives stopped."""
    shift = time.time() + LEAD - begin
    for due, action in [*actions, (end, lambda _: None)]:
        while (now := time.time() - shift) < due:
            snapshot = loop.snapshot()
            if not snapshot.state.is_active:
                return Stop(now, snapshot.cause, snapshot.state is ControllerState.BUS_LOST)
            loop.feed()
            time.sleep(min(PERIOD, due - now))
        action(shift)
    return None
