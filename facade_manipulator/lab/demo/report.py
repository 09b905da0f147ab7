"""What the demo leaves: summary.json, pictures and an animation, each whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
import json
from pathlib import Path
from typing import Any

from facade_manipulator.files import atomic_write
from facade_manipulator.kinematics import Geometry
from facade_manipulator.lab.demo.record import Recorder, TimeCourse
from facade_manipulator.lab.gondola import AXES, Scenario
from facade_manipulator.ros import ManipulatorClient

KEPT = ('disturbance_rms', 'residual_rms', 'attenuation_db')  # of each axis
SUMMARY = 'summary.json'
TIME_COURSES, SPECTRUM, PATH, FORCE, LINKAGE = PICTURES = (
    'time_courses.png', 'spectrum.png', 'path.png', 'force.png', 'linkage.gif')
LEAST_SAMPLES = 10


def summarise(measured: dict, client: ManipulatorClient, duration: float) -> dict:
    """
    Return what summary.json holds of a run whose strokes took a duration [s].

    `measured` is the gondola simulator's report; the client knows the nodes' last counters.
    """
    def count(component: str, key: str) -> int:
        return int(client.value(component, key) or 0)

    return {
        'axes': {axis: {key: measured['axes'][axis][key] for key in KEPT} for axis in AXES},
        'duration_s': round(duration, 3),
        'pipeline_latency_ms': _latency(client),
        'bus_cycles': count('driver: bus', 'cycles'),
        'missed_cycles': count('driver: bus', 'missed cycles'),
        'rejected_goals': count('ik_service: goal', 'rejected'),
        'drive_faults': count('driver: operation', 'drive faults'),
    }


def _latency(client: ManipulatorClient) -> dict[str, float | None]:
    """
    From the compensator's decision to the SYNC at which the drives take the target.

    The compensator stamps its poses a horizon ahead of the decision, and the driver publishes how
    much of it was left (margin) when it chose the target of a cycle.
    """
    operation = 'driver: operation'
    horizon = client.value('compensator: correction', 'horizon [ms]')
    ahead = client.value(operation, 'targets ahead of their SYNC [ms]')
    margins = {
        'p50': client.value(operation, 'setpoint margin p50 [ms]'),
        'p99': client.value(operation, 'setpoint margin p1 [ms]'),
    }
    return {
        name: round(float(horizon) - float(ahead) - float(margin), 3)
        if horizon and ahead and margin else None
        for name, margin in margins.items()}


def write_json(path: Path, content: Any) -> None:
    """Write a JSON file whole or not at all."""
    with atomic_write(path) as draft:
        draft.write_text(json.dumps(content, indent=2) + '\n')


def remove_pictures(folder: Path) -> None:
    """Remove an earlier run's pictures: beside a new summary they would mislead."""
    for name in PICTURES:
        (folder / name).unlink(missing_ok=True)


def draw(
    folder: Path, recorder: Recorder, summary: dict, scenario: Scenario, geometry: Geometry
) -> Iterator[float]:
    """
    Draw everything and yield the share that is done, 0 to 1.

    Who closes the iterator early leaves only complete files.
    """
    # matplotlib comes in here, so that the nodes' start does not wait for it
    from facade_manipulator.lab.demo import animation
    from facade_manipulator.lab.gondola.pictures import save

    course = recorder.newest()
    if len(course.times) < LEAST_SAMPLES:
        return
    for done, (name, figure) in enumerate(_figures(recorder, course, summary, scenario), 1):
        with atomic_write(folder / name) as draft:
            save(figure, draft)
        yield 0.1 * done
    images = []
    for image in animation.frames(course, geometry, scenario.facade):
        images.append(image)
        yield 0.4 + 0.5 * len(images) / animation.FRAMES
    with atomic_write(folder / LINKAGE) as draft:
        animation.save(draft, images)
    yield 1.0


def _figures(
    recorder: Recorder, course: TimeCourse, summary: dict, scenario: Scenario
) -> Iterator[tuple[str, Any]]:
    """Yield the name and the figure of each picture."""
    from facade_manipulator.lab.demo import pictures

    yield TIME_COURSES, pictures.time_courses(recorder.entire(), summary['axes'])
    yield SPECTRUM, pictures.spectrum(course)
    yield PATH, pictures.paths(course)
    times, forces = recorder.forces()
    impedance = scenario.compensator.impedance
    if len(times):
        yield FORCE, pictures.pressing(
            course, times, forces, impedance.force if impedance.enabled else None)
