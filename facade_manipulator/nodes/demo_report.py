"""What the demo leaves: summary.json, pictures and an animation, each whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import json
import math
from pathlib import Path
from typing import Any

from facade_manipulator.kinematics import Geometry
from facade_manipulator.nodes.demo_record import Recorder
from facade_manipulator.simulation.scenario import Scenario

AXES = ('x', 'y', 'theta')
UNITS = {'x': ('mm', 1e3), 'y': ('mm', 1e3), 'theta': ('°', math.degrees(1.0))}
SUMMARY = 'summary.json'
TIME_COURSES, SPECTRUM, PATH, FORCE, LINKAGE = PICTURES = (
    'time_courses.png', 'spectrum.png', 'path.png', 'force.png', 'linkage.gif')
LEAST_SAMPLES = 10


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Give a draft to write; it gets its name when it is complete and goes when it is not."""
    draft = path.with_suffix('.part')
    try:
        yield draft
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def write_json(path: Path, content: Any) -> None:
    """Write a JSON file whole or not at all."""
    with whole(path) as draft:
        draft.write_text(json.dumps(content, indent=2) + '\n')


def remove_pictures(folder: Path) -> None:
    """Remove an earlier run's pictures: beside a new summary they would mislead."""
    for name in PICTURES:
        (folder / name).unlink(missing_ok=True)


def draw(
    folder: Path, recorder: Recorder, summary: dict, scenario: Scenario, geometry: Geometry
) -> Iterator[float]:
    """
    Draw everything; who closes the iterator early leaves only complete files.

    Parameters
    ----------
    folder : pathlib.Path
    recorder : Recorder
    summary : dict
    scenario : Scenario
        Of it the wall and the desired force.
    geometry : Geometry

    Yields
    ------
    float
        Share that is done, 0 to 1.

    """
    # matplotlib comes in here, so that the nodes' start does not wait for it
    from facade_manipulator.nodes import demo_animation, demo_pictures

    course = recorder.newest()
    if len(course.times) < LEAST_SAMPLES:
        return
    times, forces = recorder.forces()
    pictures = {
        TIME_COURSES: lambda draft: demo_pictures.draw_time_courses(
            draft, recorder.whole(), summary['axes']),
        SPECTRUM: lambda draft: demo_pictures.draw_spectrum(draft, course),
        PATH: lambda draft: demo_pictures.draw_paths(draft, course),
    }
    if len(times):
        pictures[FORCE] = lambda draft: demo_pictures.draw_pressing(
            draft, times, forces, _desired(scenario))
    for done, (name, picture) in enumerate(pictures.items()):
        yield 0.1 * done
        with whole(folder / name) as draft:
            picture(draft)
    images = []
    for image in demo_animation.frames(course, geometry, scenario.facade):
        images.append(image)
        yield 0.4 + 0.5 * len(images) / demo_animation.FRAMES
    with whole(folder / LINKAGE) as draft:
        demo_animation.save(draft, images)
    yield 1.0


def _desired(scenario: Scenario) -> float | None:
    """Return the force with which the head is to press [N], None if it does not give way."""
    impedance = scenario.compensator.impedance
    return impedance.force if impedance.enabled else None
