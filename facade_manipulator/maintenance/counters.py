"""
Hours, travel, reversals and loads of the axes, starts and stops of the machine.

References
----------
ISO 3408-5:2006, 4.2: the mean axial load of a ball screw is the cubic mean of the load over the
travel; its life goes with the third power.

"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, ClassVar, NamedTuple, TypeVar

from facade_manipulator.drives.controller import AxisSnapshot, ControllerSnapshot, ControllerState
from facade_manipulator.errors import InputError, without_numbers
from facade_manipulator.parameters import parameter, settings
from facade_manipulator.resources import STATE_FOLDER

DEAD_BAND = 5e-5  # m: below it an encoder's noise is no travel and no reversal
LONGEST_STEP = 1.0  # s: of a longer gap nothing is known
MOST_CAUSES = 30  # that are counted each for itself
OTHER = 'other causes'


@settings
class ServiceSettings:
    """After how much work the machine wants service; 0 asks for none."""

    folder: str = parameter(
        'Folder of the counters; empty: none are kept', default=STATE_FOLDER,
        read_only=True)
    hours: float = parameter(
        'Time under power after which service of a drive is due, 0 for never', default=0.0,
        unit='h', minimum=0.0, maximum=1e6)
    travel: float = parameter(
        'Travel after which service of a screw is due, 0 for never', default=0.0, unit='km',
        minimum=0.0, maximum=1e6)


@dataclass
class AxisCounters:
    """Counters of one axis."""

    travel: float = 0.0  #: [m]
    cubed_load: float = 0.0  #: integral of the cube of the force over the travel [N³ m]
    reversals: int = 0
    greatest_following_error: float = 0.0  #: [m]
    drive: str = ''  #: its serial number; empty before one was read
    serviced: float = 0.0  #: `worked` at the last service of the screw
    unit: ClassVar[str] = 'km'

    @property
    def worked(self) -> float:
        """Travel [km]."""
        return 1e-3 * self.travel

    @property
    def mean_load(self) -> float:
        """Cubic mean of the force over the travel [N]."""
        return (self.cubed_load / self.travel) ** (1.0 / 3.0) if self.travel else 0.0


@dataclass
class DriveCounters:
    """Counters of one drive, which go with it to another axis."""

    hours: float = 0.0  #: under power [h]
    serviced: float = 0.0  #: `worked` at its last service
    unit: ClassVar[str] = 'h'

    @property
    def worked(self) -> float:
        """Time under power [h]."""
        return self.hours


class Part(NamedTuple):
    """A part with a service interval of its own."""

    name: str  #: as q1_screw, q1_drive
    counters: AxisCounters | DriveCounters

    @property
    def since_service(self) -> float:
        """What it has done since its last service, in its unit."""
        return self.counters.worked - self.counters.serviced


@dataclass
class MachineCounters:
    """Counters of a machine."""

    hours: float = 0.0  #: under power [h]
    starts: int = 0  #: activations
    #: how often the drives were stopped, by cause without its numbers
    stops: dict[str, int] = field(default_factory=dict)
    drives: dict[str, DriveCounters] = field(default_factory=dict)  #: by serial number
    #: services and exchanged drives, by when [h]
    history: dict[str, str] = field(default_factory=dict)
    axes: dict[str, AxisCounters] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._time: float | None = None
        self._state = ControllerState.UNCONFIGURED
        self._last: dict[str, tuple[float, float]] = {}  # position, direction

    @staticmethod
    def of(values: Mapping[str, Any]) -> MachineCounters:
        """
        Make counters of what `values` returned; what is unknown here stays in the file.

        Raises a TypeError, ValueError or AttributeError if they are no counters.
        """
        made = _known(MachineCounters, values)
        made.stops = {cause: int(count) for cause, count in made.stops.items()}
        made.axes = {name: _known(AxisCounters, one)
                     for name, one in values.get('axes', {}).items()}
        made.drives = {number: _known(DriveCounters, one)
                       for number, one in values.get('drives', {}).items()}
        return made

    def values(self) -> dict[str, Any]:
        """Return the counters as plain values."""
        return asdict(self)

    @property
    def events(self) -> int:
        """Number of what must not wait to be written: starts, stops, services, exchanges."""
        return self.starts + sum(self.stops.values()) + len(self.history)

    @property
    def is_counting(self) -> bool:
        """Return whether the drives had power when last seen."""
        return self._state.has_power

    def note(self, now: float, snapshot: ControllerSnapshot) -> None:
        """Count what happened between the snapshot before and this one at a time [s]."""
        before, self._state = self._state, snapshot.state
        elapsed = 0.0 if self._time is None else now - self._time
        self._time = now
        is_gap = not 0.0 <= elapsed <= LONGEST_STEP
        worked = elapsed / 3600.0 if before.has_power and not is_gap else 0.0
        self.hours += worked
        if snapshot.state is ControllerState.ACTIVE is not before:
            self.starts += before is ControllerState.ACTIVATING
        if snapshot.state is ControllerState.STOPPED is not before:
            self._count_stop(snapshot.cause)
        for axis in snapshot.axes:
            self._note_drive(axis, worked)
            self._note_axis(axis, is_gap)

    def _count_stop(self, cause: str) -> None:
        name = without_numbers(cause)
        if name not in self.stops and len(self.stops) >= MOST_CAUSES:
            name = OTHER
        self.stops[name] = self.stops.get(name, 0) + 1

    def _note_drive(self, axis: AxisSnapshot, worked: float) -> None:
        number = str(axis.serial_number or '')
        counters = self.axes.setdefault(axis.name, AxisCounters())
        if number and counters.drive not in ('', number):
            self._record(f'{axis.name}: drive {counters.drive} replaced by {number}')
        counters.drive = number or counters.drive
        if worked:  # a drive without a number counts for its axis
            self.drives.setdefault(number or axis.name, DriveCounters()).hours += worked

    def _record(self, event: str) -> None:
        at = f'{self.hours:.3f} h'
        self.history[at] = '; '.join(filter(None, (self.history.get(at), event)))

    def _note_axis(self, axis: AxisSnapshot, is_gap: bool) -> None:
        if axis.position is None or not axis.homed:
            self._last.pop(axis.name, None)  # it counts from elsewhere when it comes back
            return
        counters = self.axes.setdefault(axis.name, AxisCounters())
        if self.is_counting and axis.following_error is not None:
            counters.greatest_following_error = max(
                counters.greatest_following_error, abs(axis.following_error))
        last, direction = self._last.get(axis.name, (axis.position, 0.0))
        step = axis.position - last
        if is_gap or axis.name not in self._last:
            self._last[axis.name] = axis.position, 0.0
        elif abs(step) >= DEAD_BAND:
            counters.travel += abs(step)
            counters.cubed_load += abs(axis.force or 0.0) ** 3 * abs(step)
            counters.reversals += step * direction < 0.0
            self._last[axis.name] = axis.position, step

    def parts(self) -> Iterator[Part]:
        """Yield screws and drives of the axes."""
        for name, axis in self.axes.items():
            yield Part(f'{name}_screw', axis)
            if drive := self.drives.get(axis.drive or name):
                yield Part(f'{name}_drive', drive)

    def record_service(self, name: str = '') -> str:
        """
        Begin the interval of a part, or of all, again; return what was done.

        Raises an InputError for a part that has not worked yet.
        """
        done = [part for part in self.parts() if name in ('', part.name)]
        if not done:
            raise InputError('names', f'no work of {name or "this machine"} is counted yet: '
                             'its interval has not begun')
        text = ', '.join(f'{part.name} after {part.since_service:.3f} {part.counters.unit}'
                         for part in done)
        for part in done:
            part.counters.serviced = part.counters.worked
        self._record(f'service of {text}')
        return f'the service interval begins again: {text}'

    def due(self, settings: ServiceSettings) -> str:
        """Return which service is due; empty if none is."""
        bounds = {'h': settings.hours, 'km': settings.travel}
        return '; '.join(
            f'service of {part.name} is due: {part.since_service:.1f} {unit} since the last, '
            f'bound {bounds[unit]:g} {unit}'
            for part in self.parts()
            if 0.0 < bounds[unit := part.counters.unit] <= part.since_service)

    def lines(self) -> Iterator[tuple[str, str]]:
        """Yield names and values for people."""
        yield 'under power [h]', f'{self.hours:.2f}'
        yield 'starts', str(self.starts)
        for name, axis in self.axes.items():
            yield f'{name} travel [km]', f'{1e-3 * axis.travel:.4f}'
            yield f'{name} reversals', str(axis.reversals)
            yield f'{name} mean load over travel [N]', f'{axis.mean_load:.1f}'
            yield (f'{name} greatest following error [mm]',
                   f'{1e3 * axis.greatest_following_error:.3f}')
        for number, drive in self.drives.items():
            yield f'drive {number} under power [h]', f'{drive.hours:.2f}'
        for part in self.parts():
            yield (f'{part.name} since its service [{part.counters.unit}]',
                   f'{part.since_service:.3f}')
        yield from ((f'at {at}', event) for at, event in self.history.items())
        for cause, count in sorted(self.stops.items(), key=lambda stop: -stop[1]):
            yield f'stops: {cause}', str(count)


Counters = TypeVar('Counters', AxisCounters, DriveCounters, MachineCounters)
# fields that came after 0.2.0, whose files may lack them
LATER = ('drive', 'drives', 'history', 'serviced')


def lacking(values: Mapping[str, Any]) -> Iterator[str]:
    """Yield which counters a file should have and has not."""
    kinds: list[tuple[type, str, Mapping[str, Any]]] = [(MachineCounters, '', values), *(
        (AxisCounters, f' of {name}', axis) for name, axis in values.get('axes', {}).items())]
    for kind, where, found in kinds:
        yield from (item.name + where for item in fields(kind)
                    if item.name not in (*found, *LATER))


def _known(kind: type[Counters], values: Mapping[str, Any]) -> Counters:
    """Make an object of those values that this version knows."""
    new = kind()
    return kind(**{name: type(getattr(new, name))(value) for name, value in values.items()
                   if name in {item.name for item in fields(kind)}})
