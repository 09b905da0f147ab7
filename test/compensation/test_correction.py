"""Correction that fades, switches and bridges without jumps."""

from copy import deepcopy
from functools import cache
import math

from compensation.compensated_head import CompensatedHead, PERIOD
import gusts as law
import numpy as np
import pytest

from facade_manipulator.compensation.correction import (
    CorrectionMode,
    CorrectionSettings,
)
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Pose
from facade_manipulator.kinematics.planar import compose, invert
from facade_manipulator.prediction.estimate import ALL_KNOWN, Estimate

pytestmark = pytest.mark.long

HORIZON = 0.06  # s
VARIANCES = Pose(1e-6, 1e-6, 3e-6)


def breeze(time):
    x = 0.1 * math.sin(0.7 * time) + 0.02 * math.sin(1.9 * time + 1.0)
    y = 0.015 * math.sin(1.26 * time)
    return Pose(x, y, 0.035 * math.sin(0.94 * time + 0.5))


class Run(CompensatedHead):
    """A correction with noisy estimates at 50 Hz, which no gate checks."""

    def __init__(self, motion=breeze, **settings):
        super().__init__(
            motion, rate=50.0, age=0.05, correction=CorrectionSettings(**settings)
        )
        self.random = np.random.default_rng(0)
        self.noise = 1.0  # share of the published deviation
        self.correction = self.compensator.correction
        del self.compensator  # a run is copied, which no path permits

    def add_estimate(self, stamp):
        if self.heard:
            noise = self.noise * self.random.standard_normal(3) * (1e-3, 1e-3, 1.7e-3)
            wrong = self.lie.pop(0) if self.lie else 0.0
            pose = Pose(*(self.motion(stamp) + noise + wrong).tolist())
            estimate = Estimate(stamp, pose, VARIANCES, self.known)
            self.correction.add_estimate(estimate)

    def update(self):
        return self.correction.at(self.now, self.now + HORIZON)

    def go(self, duration, heard=True, known=ALL_KNOWN, lie=()):
        self.heard = heard
        self.known = known
        self.lie = [*lie]
        return self.run(duration)

    def error(self):
        return np.subtract(self.last.position, self.motion(self.now + HORIZON))

    def assert_no_step(self):
        """Require that the correction changes hardly more per cycle than in the previous cycle."""
        departures = abs(np.diff(self.all('position'), 2, axis=0))
        assert (departures.max(axis=0) < (1e-3, 1e-3, math.radians(0.1))).all()


def settle(motion=breeze):
    """Return a run after 20 s, with the outputs that the next second difference needs."""
    run = Run(motion).go(20.0)
    del run.outputs[:-2]
    return run


@pytest.fixture(scope='module')
def settled():
    return settle()


@pytest.mark.parametrize(
    ('enabled', 'heard', 'mode'),
    [(False, True, CorrectionMode.DISABLED), (True, False, CorrectionMode.SILENT)],
)
def test_correction_fades_in_and_out_without_a_step(enabled, heard, mode):
    run = Run()
    for _ in range(2):
        run.go(8.0)
        assert run.correction.mode is CorrectionMode.ACTIVE
        assert abs(run.error()) == pytest.approx(0.0, abs=4e-3)
        run.correction.enabled = enabled
        run.go(6.0, heard)
        assert run.correction.mode is mode
        run.correction.enabled = True
        assert run.last.position == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
    assert run.outputs[0].position == (0.0, 0.0, 0.0)
    run.assert_no_step()


@pytest.mark.parametrize(
    ('elapsed', 'is_learnt'), [(0.02, True), (0.01, False), (-0.01, False)]
)
def test_estimate_is_learnt_only_after_a_minimum_interval(elapsed, is_learnt):
    run = Run().go(2.0)
    predictor = run.correction.predictor
    last = predictor.stamp
    since = predictor.since
    run.correction.add_estimate(
        Estimate(last + elapsed, breeze(last + elapsed), VARIANCES)
    )
    assert predictor.stamp == last + elapsed * is_learnt
    assert predictor.since == since  # nothing is learnt again


def test_short_silence_is_bridged_by_the_prediction(settled):
    run = deepcopy(settled).go(0.4, heard=False)
    assert run.correction.mode is CorrectionMode.ACTIVE
    assert abs(run.error()) == pytest.approx(0.0, abs=4e-3)
    run.go(1.0)
    run.assert_no_step()


@pytest.mark.parametrize(('gap', 'bound'), [(0.6, 4e-3), (0.8, 13e-3), (0.95, 24e-3)])
def test_gap_below_one_second_adds_only_prediction_error(settled, gap, bound):
    run = deepcopy(settled).go(gap, heard=False)
    assert run.correction.mode is CorrectionMode.ACTIVE
    assert run.correction.is_silent(run.now)
    run.go(0.1)
    assert abs(run.error()) == pytest.approx(0.0, abs=bound)
    run.go(0.6)
    assert abs(run.error()) == pytest.approx(0.0, abs=4e-3)
    run.assert_no_step()


def test_interrupted_correction_resumes_with_its_full_share(settled):
    run = deepcopy(settled)
    while run.correction.mode is CorrectionMode.ACTIVE:
        run.go(PERIOD, heard=False)
    at_once = abs(run.go(0.1).error())
    assert run.correction.mode is CorrectionMode.ACTIVE
    run.go(1.5)
    assert (abs(run.error()) < 0.15 * at_once + 2e-3).all()
    run.assert_no_step()


def test_axis_found_during_a_silence_begins_without_a_share(settled):
    run = deepcopy(settled).go(7.0, known=(False, True, True))
    run.go(0.45)
    while run.correction.mode is CorrectionMode.ACTIVE:
        run.go(PERIOD, heard=False)
    run.go(0.1)
    assert run.correction.usable == ALL_KNOWN
    assert abs(run.last.position.x) < 0.05 * abs(breeze(run.now).x)


def test_tare_makes_the_present_disturbance_nominal_without_a_step(settled):
    run = deepcopy(settled)
    nominal = run.correction.tare(run.now)
    assert nominal == pytest.approx(tuple(breeze(run.now)), abs=4e-3)
    run.go(8.0)
    expected = compose(invert(nominal), breeze(run.now + HORIZON))
    assert run.last.position == pytest.approx(tuple(expected), abs=3e-3)
    run.assert_no_step()


@pytest.mark.parametrize(
    ('heard', 'message'), [(False, 'no estimate was received'), (True, 's old')]
)
def test_tare_without_a_fresh_estimate_is_rejected(heard, message):
    run = Run().go(1.0, heard)
    run.go(2.0, heard=False)
    with pytest.raises(ManipulatorError, match=message):
        run.correction.tare(run.now)


@pytest.mark.parametrize(
    ('known', 'axes'),
    [((False, False, False), 'x, y, theta are'), ((False, True, True), 'x is')],
)
def test_tare_with_an_unmeasured_axis_is_rejected(settled, known, axes):
    run = deepcopy(settled).go(5.0, known=known)
    with pytest.raises(ManipulatorError, match=f'^tare rejected: {axes} not measured'):
        run.correction.tare(run.now)
    run.go(1.0)
    run.correction.tare(run.now)


def test_tare_keeps_the_offset_of_an_axis_never_measured():
    run = Run().go(8.0, known=(False, True, True))
    nominal = run.correction.tare(run.now)
    assert nominal.x == 0.0
    assert nominal[1:] == pytest.approx(tuple(breeze(run.now))[1:], abs=4e-3)


def test_tare_without_any_measured_axis_is_rejected():
    run = Run().go(1.0, known=(False, False, False))
    with pytest.raises(ManipulatorError, match='x, y, theta are not measured'):
        run.correction.tare(run.now)


@pytest.mark.parametrize(
    ('share', 'constant'), [(0.2, 0.015), (0.4, 0.015), (1.0, 0.03)]
)
def test_smoothing_follows_the_noise_of_the_estimates(share, constant):
    run = Run()
    run.noise = share
    run.go(12.0)
    assert run.correction._smoothing == pytest.approx(constant, rel=0.1)


def test_fading_is_the_motion_by_an_estimator_step(settled):
    run = deepcopy(settled)
    moved_by = np.zeros(3)
    for _ in range(400):
        run.go(PERIOD, lie=[0.03])
        moved_by += PERIOD * np.array(run.correction.fading)
    assert moved_by == pytest.approx(np.full(3, 0.03), abs=5e-3)


@pytest.mark.parametrize('lost', range(3))
def test_unknown_axis_fades_out_and_in_without_the_others(settled, lost):
    known = tuple(axis != lost for axis in range(3))
    run = deepcopy(settled)
    for _ in range(2):
        run.go(6.0, known=known)
        assert run.correction.usable == known
        assert run.correction.mode is CorrectionMode.ACTIVE
        assert run.last.position[lost] == pytest.approx(0.0, abs=1e-4)
        assert run.last.velocity[lost] == pytest.approx(0.0, abs=1e-4)
        assert (np.delete(abs(run.error()), lost) < 5e-3).all()
        run.go(6.0)
        assert run.correction.usable == ALL_KNOWN
        assert (abs(run.error()) < 5e-3).all()
    run.assert_no_step()


def test_axis_counts_as_known_after_the_settling_time():
    run = Run().go(5.0)
    for _ in range(3):
        run.go(0.3, known=(True, False, True)).go(0.3)
        assert run.correction.usable == (True, False, True)
    run.go(0.3)
    assert run.correction.usable == ALL_KNOWN


@pytest.fixture(scope='module')
def gusty():
    signal = law.gusts(1, 0.005)  # of estimates, and of the horizon

    def motion(time):
        number = round((time - 1000.0) / 0.005)
        return Pose(*signal[number].tolist())

    return settle(motion)


@cache
def undisturbed(settled, duration):
    """Return the corrections of a run that continues for a time [s]."""
    return deepcopy(settled).go(duration).all('position')


def moved(settled, size, duration, after=1.0, shape=np.ones_like):
    """Return the largest change of x, y, theta by estimates wrong by `size` deviations."""
    count = round(0.5 * duration / PERIOD)
    shares = np.arange(1, count + 1) / count
    lie = size * shape(shares)[:, None] * np.sqrt(VARIANCES)
    wrong = deepcopy(settled).go(duration, lie=lie).go(after).all('position')
    return abs(wrong - undisturbed(settled, duration + after)).max(axis=0)


@pytest.mark.parametrize('motion', ['settled', 'gusty'])
@pytest.mark.parametrize(
    'shape',
    [
        lambda share: np.sin(np.pi * share),
        lambda share: 1.0 - abs(2.0 * share - 1.0),
        lambda share: share,
        lambda share: share**2,
    ],
)
@pytest.mark.parametrize(
    ('size', 'bound'), [(5.0, 5.0), (8.0, 7.0), (30.0, 5.0), (-100.0, 5.0)]
)
def test_wrong_estimates_of_any_shape_hardly_move_the_head(
    request, motion, shape, size, bound
):
    run = request.getfixturevalue(motion)
    largest = moved(run, size, 0.2, shape=shape)
    assert (largest < bound * np.sqrt(VARIANCES)).all()


def test_lasting_step_of_the_estimates_is_followed(settled):
    assert (moved(settled, 30.0, 8.0) > 27.0 * np.sqrt(VARIANCES)).all()
