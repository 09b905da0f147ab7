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
from typing import Any, TypeVar

from facade_manipulator.drives.controller import (
    AxisSnapshot,
    ControllerSnapshot,
    ControllerState,
    POWERED_STATES,
)
from facade_manipulator.errors import without_numbers
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
        'Time under power after which service is due, 0 for never', default=0.0, unit='h',
        minimum=0.0, maximum=1e6)
    travel: float = parameter(
        'Travel of a carriage after which service is due, 0 for never', default=0.0, unit='km',
        minimum=0.0, maximum=1e6)


@dataclass
class AxisCounters:
    """Counters of one axis."""

    travel: float = 0.0  #: [m]
    cubed_load: float = 0.0  #: integral of the cube of the force over the travel [N³ m]
    reversals: int = 0
    greatest_following_error: float = 0.0  #: [m]
    drive: int = 0  #: its serial number; 0 before one was read

    @property
    def mean_load(self) -> float:
        """Cubic mean of the force over the travel [N]."""
        return (self.cubed_load / self.travel) ** (1.0 / 3.0) if self.travel else 0.0


@dataclass
class MachineCounters:
    """Counters of a machine."""

    hours: float = 0.0  #: under power [h]
    starts: int = 0  #: activations
    #: how often the drives were stopped, by cause without its numbers
    stops: dict[str, int] = field(default_factory=dict)
    #: under power, by the drive's serial number [h]: it goes with the drive to another axis
    drives: dict[str, float] = field(default_factory=dict)
    #: services and exchanged drives, by when [h]
    history: dict[str, str] = field(default_factory=dict)
    axes: dict[str, AxisCounters] = field(default_factory=dict)
    service_hours: float = 0.0  #: `hours` at the last service [h]
    service_travel: float = 0.0  #: greatest travel at the last service [m]

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
        made.drives = {number: float(hours) for number, hours in made.drives.items()}
        made.axes = {
            name: _known(AxisCounters, axis) for name, axis in values.get('axes', {}).items()}
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
        return self._state in POWERED_STATES

    @property
    def travel(self) -> float:
        """Travel of the axis that has travelled most [m]."""
        return max((axis.travel for axis in self.axes.values()), default=0.0)

    def note(self, now: float, snapshot: ControllerSnapshot) -> None:
        """Count what happened between the snapshot before and this one at a time [s]."""
        before, self._state = self._state, snapshot.state
        elapsed = 0.0 if self._time is None else now - self._time
        self._time = now
        is_gap = not 0.0 <= elapsed <= LONGEST_STEP
        worked = elapsed / 3600.0 if before in POWERED_STATES and not is_gap else 0.0
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
        if not axis.serial_number:
            return
        number, counters = str(axis.serial_number), self.axes.setdefault(axis.name, AxisCounters())
        if counters.drive not in (0, axis.serial_number):
            self._record(f'{axis.name}: drive {counters.drive} replaced by {number}')
        counters.drive = axis.serial_number
        self.drives[number] = self.drives.get(number, 0.0) + worked

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

    def record_service(self) -> None:
        """Begin the intervals again."""
        self._record(f'service, {1e-3 * self.travel:.3f} km')
        self.service_hours, self.service_travel = self.hours, self.travel

    def due(self, settings: ServiceSettings) -> str:
        """Return why service is due; empty if it is not."""
        hours = self.hours - self.service_hours
        travel = 1e-3 * (self.travel - self.service_travel)
        return '; '.join(
            f'service is due: {done:.1f} {unit} since the last, bound {bound:g} {unit}'
            for done, bound, unit in (
                (hours, settings.hours, 'h'), (travel, settings.travel, 'km'))
            if 0.0 < bound <= done)

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
        for number, hours in self.drives.items():
            yield f'drive {number} under power [h]', f'{hours:.2f}'
        yield from ((f'at {at}', event) for at, event in self.history.items())
        for cause, count in sorted(self.stops.items(), key=lambda stop: -stop[1]):
            yield f'stops: {cause}', str(count)


Counters = TypeVar('Counters', AxisCounters, MachineCounters)


def _known(kind: type[Counters], values: Mapping[str, Any]) -> Counters:
    """Make an object of those values that this version knows."""
    new = kind()
    return kind(**{name: type(getattr(new, name))(value) for name, value in values.items()
                   if name in {item.name for item in fields(kind)}})
