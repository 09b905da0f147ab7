"""
Measure what each constant and part of the control is worth: the ablation table.

The disturbance is simulated once for each scenario. The compensator, the setpoints and the
follower then run on its estimates without the world, so that a variation takes seconds. A
variation multiplies one constant in the source of its module by 0.5 or 1.5, or switches a part
off, in a process that has not imported the package yet.
"""

from __future__ import annotations

import argparse
import ast
from collections.abc import Callable, Iterator, Sequence
import importlib.abc
import importlib.util
import math
import os
from pathlib import Path
import pickle
import sys
import traceback
from typing import Any

import numpy as np
import ruckig  # noqa: F401  imported before the processes are forked
import scipy.interpolate  # noqa: F401

PACKAGE = 'facade_manipulator'
START, PERIOD = 1000.0, 0.01  # s
LEARNING_TIME = 15.0  # s, before the figures count
SETTLING_TIME = 2.5  # s, after a goal
FACTORS = (0.5, 1.5)
SKIPPED = (  # derived, for rounding, or bounds that only faulty input reaches
    'LEVEL', 'FEATURES', 'ACCELERATION', 'SAME_TIME', 'NOTHING', 'ZERO', 'PLAN_TOLERANCE',
    'ROUNDING', 'TOLERANCE', 'POINTS', 'LARGEST', 'ACCELERATION_NOISE', 'FARTHEST', 'MARGIN',
    'FUTURE_TOLERANCE', 'OLDEST_ESTIMATE', 'LONGEST_PAUSE', 'DEAD_AFTER')
SCENARIOS = ('breeze', 'three_tones', 'gusts', 'burst')
MODULES = (
    'prediction.continuation', 'prediction.estimate', 'prediction.filters', 'prediction.jumps',
    'prediction.predictor', 'prediction.prior', 'prediction.tones', 'compensation.correction',
    'motion.limits')
SCALES = np.array([1e3, 1e3, math.degrees(1.0)])  # to mm, mm, °
Variation = tuple[str, str, float]  # module, constant, factor


class ScaledConstant(importlib.abc.SourceLoader):
    """Load a module of the package with one constant multiplied."""

    def __init__(self, path: str, constant: str, factor: float) -> None:
        self._path, self._constant, self._factor = path, constant, factor

    def get_filename(self, fullname: str) -> str:
        return self._path

    def get_data(self, path: str) -> bytes:
        return Path(path).read_bytes()

    def source_to_code(self, data: bytes, path: str, *args: Any) -> Any:
        """Compile the module with the constant's value multiplied."""
        tree = ast.parse(data)
        for node in tree.body:
            if isinstance(node, ast.Assign) and self._constant in constants_of(node):
                expression = ast.unparse(node.value)
                node.value = ast.parse(
                    f'(lambda v: type(v)(x * {self._factor} for x in v) if isinstance(v, tuple) '
                    f'else type(v)(v * {self._factor}) if isinstance(v, int) '
                    f'else v * {self._factor})({expression})', mode='eval').body
        return compile(ast.fix_missing_locations(tree), path, 'exec')

    def path_stats(self, path: str) -> Any:
        raise OSError  # no cached bytecode


class Finder(importlib.abc.MetaPathFinder):
    """Find the module that has the constant."""

    def __init__(self, variation: Variation) -> None:
        module, self._constant, self._factor = variation
        self._module = f'{PACKAGE}.{module}'

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
        if fullname != self._module:
            return None
        file = str(Path(path[0]) / f'{fullname.rpartition(".")[2]}.py')
        return importlib.util.spec_from_file_location(
            fullname, file, loader=ScaledConstant(file, self._constant, self._factor))


def constants_of(node: ast.stmt) -> list[str]:
    """Return the names of constants that an assignment defines."""
    if not isinstance(node, ast.Assign):
        return []
    names = [target.id for target in node.targets if isinstance(target, ast.Name)]
    return [name for name in names if name.isupper() and name[0] != '_' and name not in SKIPPED]


def constants(module: str) -> Iterator[str]:
    """Yield the numeric constants of a module of the package."""
    path = Path(importlib.util.find_spec(PACKAGE).submodule_search_locations[0])
    tree = ast.parse((path / f'{module.replace(".", "/")}.py').read_text())
    for node in tree.body:
        if constants_of(node) and not any(
                isinstance(part, ast.Constant) and isinstance(part.value, (str, bool))
                for part in ast.walk(node.value)) and any(
                isinstance(part, ast.Constant) and isinstance(part.value, (int, float))
                for part in ast.walk(node.value)):
            yield from constants_of(node)


def in_child(function: Callable[..., Any], *arguments: Any) -> Any:
    """Return what a function returns in a forked process."""
    reading, writing = os.pipe()
    if not (child := os.fork()):
        try:
            result = function(*arguments)
        except BaseException:  # a variation may break anything
            result = traceback.format_exc(limit=-1)
        with os.fdopen(writing, 'wb') as pipe:
            pickle.dump(result, pipe)
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, 'rb') as pipe:
        result = pickle.load(pipe)
    os.waitpid(child, 0)
    return result


def record(name: str, seed: int, duration: float) -> dict[str, Any]:
    """Return the estimates on arrival and the true rail of a scenario whose head stands still."""
    from dataclasses import replace

    from facade_manipulator.kinematics import Geometry
    from facade_manipulator.simulation.world.scenario import load_scenario
    from facade_manipulator.simulation.world.world import World

    scenario = replace(load_scenario(name), seed=seed)
    world = World(scenario, Geometry(), START)
    arrivals, rails, carriages = [], [], world.carriages
    for cycle in range(round(duration / PERIOD)):
        now = START + cycle * PERIOD
        world.advance(now, carriages)
        rails.append(tuple(world.rail))
        arrivals.append([(stamp, tuple(pose), tuple(variances))
                         for stamp, pose, variances, *_ in world.estimator.receive(now)])
    return {'arrivals': arrivals, 'rails': rails, 'goals': scenario.mission.goals,
            'goal_period': scenario.mission.goal_period}


def replay(
    recording: dict[str, Any], variation: Variation | None, part: str, follow: bool,
) -> list[float]:
    """
    Return the figures of a variation with compensator, and follower at 200 Hz if asked for.

    RMS and peak errors of x, y, theta; RMS jerk; limited cycles; rejections; mean squares of the
    prediction's errors by their published variances.
    """
    vary(variation, part)
    from facade_manipulator.compensation.compensator import Compensator
    from facade_manipulator.errors import ManipulatorError
    from facade_manipulator.kinematics import Geometry, Pose

    compensator = Compensator(Geometry())
    period, goals, poses, rejected = recording['goal_period'], recording['goals'], [], 0
    for cycle, arrivals in enumerate(recording['arrivals']):
        now = START + cycle * PERIOD
        if cycle % round(period / PERIOD) == 0:
            compensator.set_goal(Pose(*goals[int((now - START) / period) % len(goals)]))
        for stamp, pose, variances in arrivals:
            try:
                compensator.add_estimate(now, stamp, Pose(*pose), variances)
            except ManipulatorError:
                rejected += 1
        corrected = compensator.update(now)
        is_learnt, predictor = cycle * PERIOD > 1.0, compensator.correction.predictor
        poses.append((corrected, is_learnt and predictor.predict(corrected.time).position,
                      is_learnt and predictor.deviations(corrected.time)))
    errors, squares = errors_of(recording, poses)
    sent, limited = followed(poses) if follow else ([one.pose for one, *_ in poses], 0)
    step = 0.5 * PERIOD if follow else PERIOD
    jerk = np.diff(sent[round(LEARNING_TIME / step):], 3, axis=0) / step ** 3
    return [*figures_of(errors), float(np.sqrt((jerk ** 2).mean())), limited, rejected,
            *np.mean(squares, axis=0)]


def vary(variation: Variation | None, part: str) -> None:
    """Apply a variation in this process."""
    if variation is not None:
        sys.meta_path.insert(0, Finder(variation))
    if part:
        switch_off(part)


def errors_of(recording: dict[str, Any], poses: list[Any]) -> tuple[list[Any], list[Any]]:
    """Return errors of the head on the wall, and squares of the prediction's by its variances."""
    from facade_manipulator.kinematics import compose, difference, Pose

    errors, squares, rails = [], [], recording['rails']
    for corrected, predicted, deviations in poses:
        elapsed = corrected.time - START
        ahead = round(elapsed / PERIOD)
        is_settled = elapsed % recording['goal_period'] > SETTLING_TIME
        if ahead < len(rails) and elapsed > LEARNING_TIME and is_settled:
            rail = Pose(*rails[ahead])
            errors.append(difference(compose(rail, corrected.pose), corrected.reference))
            squares.append((np.subtract(predicted, rail) / deviations) ** 2)
    return errors, squares


def followed(poses: list[Any]) -> tuple[list[Any], int]:
    """Return the carriages at 200 Hz, and the cycles in which limits held them back."""
    from facade_manipulator.kinematics import Geometry
    from facade_manipulator.motion.follower import SetpointFollower, StreamSettings
    from facade_manipulator.motion.guard import mechanism_guard
    from facade_manipulator.motion.limits import MotionLimits
    from facade_manipulator.motion.setpoints import GoalSettings, SetpointStream

    stream, sent = SetpointStream(Geometry(), GoalSettings()), []
    follower = SetpointFollower(
        StreamSettings(), MotionLimits(), 0.5 * PERIOD, mechanism_guard(Geometry()))
    for number, (corrected, *_) in enumerate(poses):
        setpoint, now = stream.setpoint(corrected.time, corrected.pose), START + number * PERIOD
        if not number:
            follower.reset(setpoint.position)
        follower.add(setpoint, now)
        sent.extend(follower.sample(now + 0.5 * PERIOD * half) for half in (0, 1))
    return sent, follower.limited_cycles + follower.brakes


def figures_of(errors: list[Any]) -> list[float]:
    """Return RMS and peak of errors [mm, mm, °]."""
    values = np.array(errors)
    return [*np.sqrt((values ** 2).mean(axis=0)) * SCALES, *abs(values).max(axis=0) * SCALES]


def predict(
    recording: dict[str, Any], variation: Variation | None, part: str, follow: bool,
) -> list[float]:
    """Return the figures of a variation of the prediction alone, 70 ms after each arrival."""
    vary(variation, part)
    from facade_manipulator.kinematics import Pose
    from facade_manipulator.prediction.estimate import Variances
    from facade_manipulator.prediction.predictor import DisturbancePredictor

    predictor, rails, errors, squares = DisturbancePredictor(), recording['rails'], [], []
    for cycle, arrivals in enumerate(recording['arrivals'][:-7]):
        for stamp, pose, variances in arrivals:
            if stamp > predictor.stamp:
                predictor.update(stamp, Pose(*pose), Variances(*variances))
        if arrivals and cycle * PERIOD > LEARNING_TIME:
            time = START + (cycle + 7) * PERIOD
            errors.append(np.subtract(predictor.predict(time).position, rails[cycle + 7]))
            squares.append((errors[-1] / predictor.deviations(time)) ** 2)
    return [*figures_of(errors), 0.0, 0, 0, *np.mean(squares, axis=0)]


def _with_ones(attribute: str) -> Callable[[Any], Any]:
    """Return a change of `Continuation.solve` that sets one of its results to ones."""
    def change(solve: Any) -> Any:
        def changed(self: Any, *arguments: Any) -> None:
            solve(self, *arguments)
            setattr(self, attribute, np.ones_like(getattr(self, attribute)))
        return changed
    return change


# part: module, name in it, and the replacement as a function of the original
PARTS: dict[str, tuple[str, str, Callable[[Any], Any]]] = {
    'tones': ('prediction.tones', 'Tones.fit', lambda _: lambda self, axis, variance: None),
    'jump detector': ('prediction.jumps', 'JumpDetector.evaluate',
                      lambda _: lambda self, *arguments: self._nothing),
    'smoothing of the correction': ('compensation.correction', 'SMOOTHING', lambda _: 1e-4),
    'smoothing of the follower': ('motion.follower', 'SetpointFollower._smooth',
                                  lambda _: lambda self, following: None),
    'acceleration bound (room)': ('prediction.predictor', 'DisturbancePredictor._room',
                                  lambda _: lambda self, interval, full: 1.0),
    'weakening by growth': ('prediction.continuation', 'Continuation.weaken',
                            lambda _: lambda self, share: None),
    'share of the mean': ('prediction.continuation', 'Continuation.solve', _with_ones('share')),
    'trust in tones fixed at 1': (
        'prediction.continuation', 'Continuation.solve', _with_ones('trust')),
    'prior': ('prediction.continuation', 'PRIOR_TIME', lambda time: 1e-5 * time)}


def switch_off(part: str) -> None:
    """Replace a part; raise an AttributeError if the control no longer has it."""
    module, name, change = PARTS[part]
    owner: Any = importlib.import_module(f'{PACKAGE}.{module}')
    *path, last = name.split('.')
    for step in path:
        owner = getattr(owner, step)
    setattr(owner, last, change(getattr(owner, last)))


def summary(all_figures: Sequence[list[float] | str]) -> str:
    """Return one line of figures: of each scenario RMS x / y / θ, peak, jerk, limited, NEES."""
    texts = []
    for figures in all_figures:
        if isinstance(figures, str):
            texts.append(figures.strip().splitlines()[-1][:60])
            continue
        x, y, theta, *peaks, jerk, limited, rejected, nx, ny, nt = figures
        texts.append(
            f'{x:.3f} {y:.3f} {theta:.4f} ({peaks[0]:.2f} {peaks[1]:.2f} {peaks[2]:.3f}) '
            f'j{jerk:.1f} l{limited}+{rejected} n{nx:.2f} {ny:.2f} {nt:.2f}')
    return ' | '.join(texts)


def variations(modules: Sequence[str]) -> Iterator[tuple[str, Variation | None, str]]:
    """Yield title, variation and part of each row."""
    yield 'nothing', None, ''
    for part in PARTS:
        yield f'without {part}', None, part
    for module in modules:
        for constant in constants(module):
            for factor in FACTORS:
                yield f'{module}.{constant} × {factor:g}', (module, constant, factor), ''


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description='Measure what each constant and part is worth')
    parser.add_argument('--duration', type=float, default=45.0, help='s')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--scenario', action='append', help='only this one; may be repeated')
    parser.add_argument('--module', action='append', help='only this one; may be repeated')
    options = parser.parse_args()
    names = options.scenario or SCENARIOS
    recordings = [in_child(record, name, options.seed, options.duration) for name in names]
    print(f'| varied | {" | ".join(names)} |', flush=True)
    for title, variation, part in variations(options.module or MODULES):
        is_open = 'prediction' in title
        follow = 'follower' in title or 'motion' in title
        print(f'| {title} | ' + summary([
            in_child(predict if is_open else replay, recording, variation, part, follow)
            for recording in recordings]) + ' |', flush=True)


if __name__ == '__main__':
    main()
