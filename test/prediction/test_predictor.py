"""How well the disturbance is predicted, and what happens where it cannot be."""

from __future__ import annotations

from copy import deepcopy
from functools import cache
import math

import gusts as law
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.kinematics import Pose
from facade_manipulator.prediction.predictor import (
    ACCELERATION_LIMITS,
    ACCELERATION_NOISE,
    DisturbancePredictor,
    PEAK_TIME,
)

HORIZON = 0.12
NOISE = 1e-3
VARIANCES = Pose(NOISE ** 2, NOISE ** 2, NOISE ** 2)
LIKE_X = np.full(3, ACCELERATION_LIMITS[0])


def sines(*axes):
    return lambda time: np.array([
        sum(amplitude * math.sin(math.tau * frequency * time + phase)
            for amplitude, frequency, phase in parts) for parts in axes])


@cache
def gusts(seed, scale=1.0):
    """Return a motion in gusts of 4 m/s, interpolated and multiplied by a factor."""
    interval = 0.01
    signal = scale * law.gusts(seed, interval)

    def motion(time):
        number, share = divmod(time / interval, 1.0)
        before, after = signal[int(number):int(number) + 2]
        return before + share * (after - before)

    return motion


def still(_):
    return np.zeros(3)


BREEZE = sines(((0.1, 0.11, 0.3), (0.02, 0.3, 1.0)), ((0.015, 0.2, 0.5),), ((0.035, 0.15, 0.0),))
THREE_TONES = sines(
    ((0.085, 0.127, 0.3), (0.018, 0.311, 1.0), (0.003, 0.83, 2.0)),
    ((0.012, 0.173, 0.5), (0.005, 0.412, 2.1), (0.001, 0.91, 0.8)),
    ((0.03, 0.15, 0.0), (0.008, 0.37, 1.3), (0.0015, 0.7, 2.6)))

SEVEN_TONES = sines(*3 * [[(0.08 * (0.1 / frequency) ** 1.5, frequency, 2.0 * frequency)
                          for frequency in (0.1, 0.17, 0.29, 0.41, 0.6, 0.83, 1.2)]])


def aside(time):
    return 0.3 + BREEZE(time)


def as_measured(stamp, values, random):
    return values


class Run:
    """A predictor fed with a motion; errors and standard deviations one horizon ahead."""

    def __init__(self, motion, duration, rate=50.0, noise=NOISE, start=1000.0, published=None,
                 spoil=as_measured, horizon=HORIZON, acceleration=ACCELERATION_LIMITS):
        self.predictor, self.rate = DisturbancePredictor(acceleration=acceleration), rate
        self._noise, self._start, self._horizon = noise, start, horizon
        self._random = np.random.default_rng(0)
        self._variances = Pose(*(3 * [(published or max(noise, 1e-4)) ** 2]))
        self.errors = self.deviations = np.empty((0, 3))
        self.go_on(motion, duration, spoil)

    def go_on(self, motion, end, spoil=as_measured):
        errors, deviations = [*self.errors], [*self.deviations]
        for k in range(len(errors), round(end * self.rate)):
            time = k / self.rate
            values = motion(time) + self._noise * self._random.standard_normal(3)
            values = spoil(time, values, self._random)
            if values is not None:
                self.predictor.update(self._start + time, Pose(*values.tolist()), self._variances)
            aim = self._start + time + self._horizon
            errors.append(
                np.subtract(self.predictor.predict(aim).position, motion(time + self._horizon)))
            deviations.append(self.predictor.deviations(aim))
        self.errors, self.deviations = np.array(errors), np.array(deviations)

    def rms(self, begin, end=None):
        part = slice(int(begin * self.rate), end and int(end * self.rate))
        return np.sqrt((self.errors[part] ** 2).mean(axis=0))


#: runs that several tests look at: they must not change them
run = cache(Run)


def gone_on(motion, spoil=as_measured, learnt=None):
    """Return the run of a motion for 20 s and 5 s of what comes then."""
    later = deepcopy(run(learnt or motion, 20.0))
    later.go_on(motion, 25.0, spoil)
    return later


@pytest.mark.long
@pytest.mark.parametrize(('motion', 'early', 'late'), [
    (BREEZE, (2.0, 1.0, 1.0), (0.3, 0.25, 0.25)),
    (THREE_TONES, (2.5, 1.5, 1.5), (0.4, 0.35, 0.35)),
    (SEVEN_TONES, (4.0, 4.0, 4.0), (1.2, 0.9, 0.9)),
    (gusts(1), (1.2, 0.8, 0.6), (0.75, 0.6, 0.6)),
    (gusts(2), (1.2, 0.8, 0.6), (0.75, 0.6, 0.6)),
    (gusts(3, 2.0), (1.4, 1.3, 1.1), (1.4, 1.1, 1.0)),
    (still, (0.5, 0.5, 0.5), (0.2, 0.2, 0.2))])
def test_sways_are_predicted_to_a_part_of_the_noise_and_as_well_as_is_said(motion, early, late):
    learnt = run(motion, 100.0)
    assert (learnt.rms(3.0, 10.0) < NOISE * np.array(early)).all()
    assert (learnt.rms(30.0, 60.0) < NOISE * np.array(late)).all()
    inside = np.abs(learnt.errors[500:]) < 2.0 * learnt.deviations[500:]
    assert 0.91 < inside.mean() < 0.99


@pytest.mark.long
def test_a_sine_is_learnt_in_a_minute():
    learnt = Run(sines(*[((0.01, frequency, 0.4),) for frequency in (0.1, 0.4, 1.3)]), 70.0,
                 acceleration=LIKE_X)
    assert (learnt.rms(60.0) < 0.4 * NOISE).all()


@pytest.mark.long
@pytest.mark.parametrize('frequency', [0.03, 0.1, 0.3, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0])
def test_no_sine_is_amplified(frequency):
    amplitudes = np.array((0.003, 0.01, 0.03))
    motion = sines(*[((one, frequency, 0.0),) for one in amplitudes])
    learnt = Run(motion, 20.0, acceleration=LIKE_X)
    floor = 0.5 * NOISE
    assert (learnt.rms(10.0) < np.hypot(amplitudes / math.sqrt(2.0), floor)).all()


def test_at_rest_less_than_half_of_the_noise_is_passed_on():
    assert (run(still, 40.0).rms(2.0) < 0.5 * NOISE).all()
    assert (run(still, 40.0).rms(20.0) < 0.2 * NOISE).all()


def test_noise_is_no_motion_and_how_strong_one_was_is_forgotten_in_half_a_minute():
    rest = deepcopy(run(still, 40.0))
    floor = NOISE ** 2 / rest.rate * ACCELERATION_NOISE
    assert (rest.predictor._peak < 6.0 * floor).all()  # seldom more than three deviations
    rest.predictor._peak[:] = 1e6 * floor
    rest.go_on(still, 42.0)
    assert rest.predictor._peak == pytest.approx(1e6 * floor * math.exp(-2.0 / PEAK_TIME))


def test_what_cannot_be_predicted_is_not_amplified():
    random = np.random.default_rng(5)
    shakes = 0.01 * random.standard_normal((4000, 3))
    run = Run(lambda time: shakes[round(time * 50.0)], 40.0)
    assert (run.rms(10.0) < 1.05 * 0.01).all()


def test_an_acceleration_beyond_the_limit_is_compensated_in_part_and_in_phase():
    run = Run(sines(((0.02, 2.0, 0.0),), (), ()), 25.0)
    share = ACCELERATION_LIMITS[0] / (0.02 * (math.tau * 2.0) ** 2)
    assert run.rms(12.0)[0] == pytest.approx((1.0 - share) * 0.02 / math.sqrt(2.0), rel=0.15)


bounded = st.tuples(*3 * [st.floats(-0.5, 0.5)])
intervals = st.one_of(st.floats(1e-3, 0.1), st.floats(0.1, 5.0), st.floats(-1.0, 0.0))


@pytest.mark.long
@given(st.lists(st.tuples(intervals, bounded), min_size=1, max_size=60), st.floats(1e-4, 0.1))
def test_bounded_estimates_give_a_bounded_prediction(estimates, deviation):
    predictor, stamp = DisturbancePredictor(), 1000.0
    for interval, values in estimates:
        stamp += interval
        predictor.update(stamp, Pose(*values), Pose(*(3 * [deviation ** 2])))
        for ahead in (-0.5, 0.0, 0.05, 0.12, 0.37, 0.6, 1.0, 100.0):
            course = predictor.predict(stamp + ahead)
            assert np.abs(course.position).max() < 3.0
            assert np.abs(course.velocity).max() < 30.0
        assert np.isfinite(predictor.deviations(stamp + HORIZON)).all()


def test_whatever_was_learnt_a_prediction_is_bounded():
    predictor = Run(BREEZE, 10.03).predictor
    predictor._weights[:] = 1e9
    predictor._share[:] = 1.0
    stamp = predictor.stamp + 0.02
    predictor.update(stamp, Pose(0.1, 0.0, 0.0), VARIANCES)
    assert np.abs(predictor.predict(stamp + HORIZON).position).max() < 1.0


@pytest.mark.long
def test_after_minutes_of_anything_a_prediction_is_bounded():
    """Random walks between bounds, jumps and sines that start and stop: it never runs away."""
    random, predictor = np.random.default_rng(0), DisturbancePredictor()
    values, worst = np.zeros(3), 0.0
    for k in range(6000):
        values = np.clip(values + 0.02 * random.standard_normal(3), -0.3, 0.3)
        if random.random() < 0.01:
            values = random.uniform(-0.3, 0.3, 3)
        predictor.update(0.02 * k, Pose(*values.tolist()), VARIANCES)
        worst = max(worst, np.abs(predictor.predict(0.02 * k + HORIZON).position).max())
    assert worst < 1.0


@cache
def predictions(motion, start=1000.0, scale=1.0, offset=0.0):
    random, predictor = np.random.default_rng(3), DisturbancePredictor(
        acceleration=np.full(3, 50.0), speed=50.0)
    found = []
    for k in range(500):
        values = scale * (motion(k / 50.0) + NOISE * random.standard_normal(3)) + offset
        predictor.update(start + k / 50.0, Pose(*values.tolist()), Pose(*np.multiply(
            scale ** 2, VARIANCES)))
        found.append(predictor.predict(start + k / 50.0 + HORIZON).position)
    return np.array(found)


@pytest.mark.parametrize('change', [
    {'start': 0.0}, {'scale': -1.0}, {'scale': 2.5}, {'scale': 0.1}, {'offset': 0.4}])
def test_a_prediction_depends_on_no_time_sign_unit_or_origin(change):
    scale, offset = change.get('scale', 1.0), change.get('offset', 0.0)
    expected = scale * predictions(BREEZE) + offset
    assert np.abs(predictions(BREEZE, **change) - expected).max() < 1e-6 * abs(scale)


def test_axes_do_not_see_one_another():
    sway = ((0.1, 0.11, 0.3), (0.02, 0.3, 1.0))
    beside = predictions(sines(((0.015, 0.2, 0.5),), sway, ((0.035, 0.15, 0.0),)))
    alone = predictions(sines((), sway, ()))
    assert np.abs(beside - alone)[:, 1].max() < 1e-9


@pytest.mark.long
def test_the_standard_deviation_is_that_of_the_errors_after_five_minutes_of_tones():
    learnt = Run(BREEZE, 300.0, rate=20.0)
    half = len(learnt.errors) // 2
    inside = np.abs(learnt.errors[half:]) < 2.0 * learnt.deviations[half:]
    assert (inside.mean(axis=0) > 0.93).all()


@pytest.mark.long
@pytest.mark.parametrize('rate', [15.0, 200.0])
def test_estimates_may_come_at_any_rate(rate):
    noise = NOISE * math.sqrt(rate / 50.0)
    learnt = Run(gusts(1), 30.0, rate=rate, noise=noise)
    assert (learnt.rms(20.0) < np.array((0.9, 0.8, 0.8)) * NOISE).all()


@pytest.mark.long
def test_stamps_may_jitter():
    random, predictor, errors = np.random.default_rng(1), DisturbancePredictor(), []
    motion = gusts(1)
    for k in range(2000):
        stamp = k / 50.0 + random.uniform(0.0, 0.01)
        values = motion(stamp) + NOISE * random.standard_normal(3)
        predictor.update(stamp, Pose(*values.tolist()), VARIANCES)
        errors.append(np.subtract(predictor.predict(stamp + HORIZON).position,
                                  motion(stamp + HORIZON)))
    assert (np.sqrt((np.array(errors[1000:]) ** 2).mean(axis=0)) < 0.75 * NOISE).all()


def dropped(time, values, random):
    return None if 0.0 < time % 3.0 < 0.3 and time > 1.0 else values


def struck(time, values, random):
    strikes = (random.random(3) < 0.01) * random.choice((-0.03, 0.03), 3)
    return values + strikes * (time > 5.0)


@pytest.mark.parametrize(('spoil', 'bound'), [(dropped, 1.1), (struck, 0.9)])
def test_gaps_and_outliers_do_little_harm(spoil, bound):
    assert (Run(gusts(1), 45.0, spoil=spoil).rms(20.0) < bound * NOISE).all()


@pytest.mark.long
def test_a_gap_leaves_what_was_learnt_as_it_was():
    later = gone_on(BREEZE, lambda time, values, _: None if 20.0 < time < 20.8 else values)
    assert later.rms(20.85)[0] < 2.5 * NOISE
    assert (later.rms(20.85)[1:] < 0.8 * NOISE).all()


def test_a_gap_is_bridged_by_what_a_push_would_have_made_of_it():
    error, count, step = np.array((5e-4, -5e-4, 3e-4)), 5, 0.02
    with_gap, without = (Run(still, 5.0, noise=0.0, published=NOISE).predictor for _ in range(2))
    last = with_gap.stamp
    with_gap.update(last + count * step, Pose(*error), VARIANCES)
    for share in np.arange(1, count + 1) / count:
        without.update(last + count * step * share, Pose(*(share ** 2 * error)), VARIANCES)
    assert with_gap._bank.modes == pytest.approx(without._bank.modes, abs=1e-12)


@pytest.mark.parametrize('motion', [still, BREEZE])
@pytest.mark.parametrize('step', [0.02, 0.05])
def test_a_step_of_the_estimator_moves_the_prediction_alone(motion, step):
    """What lasts a quarter of a second is true: then all is as before, but elsewhere."""
    stepped = gone_on(lambda time: motion(time) + step, learnt=motion)
    begin = 1000
    assert (np.abs(stepped.errors[begin:begin + 12]) > 0.8 * step).all()
    after = slice(begin + 13, None)
    assert np.abs(stepped.errors[after] - run(motion, 25.0).errors[after]).max() < 4.0 * NOISE


def glitch(size, duration):
    """Return how much further off a breeze's prediction is if the estimates lie for a while."""
    struck = gone_on(BREEZE, lambda time, values, _: values + size * (time < 20.0 + duration))
    return np.abs(struck.errors - run(BREEZE, 25.0).errors)


def test_a_lie_after_a_gap_moves_nothing():
    def spoil(time, values, _):
        return None if 20.0 < time < 20.09 else values + 0.03 * (20.0 < time < 20.13)

    struck = gone_on(BREEZE, spoil)
    assert np.abs(struck.errors - run(BREEZE, 25.0).errors).max() < 4.0 * NOISE


@pytest.mark.parametrize('interval', [0.02, 0.1])
def test_what_a_doubted_estimate_does_to_the_filters_can_be_taken_out_of_them(interval):
    lied, honest = (Run(BREEZE, 10.0, noise=0.1 * NOISE, published=NOISE).predictor
                    for _ in range(2))
    assert not lied._jumps.is_any
    stamp = lied.stamp + interval
    expected = honest._expected(stamp) + honest._origin
    lied.update(stamp, Pose(*(expected + 0.03)), VARIANCES)
    honest.update(stamp, Pose(*expected), VARIANCES)
    left = lied._bank.modes - lied._suspected.modes
    assert left == pytest.approx(honest._bank.modes, abs=1e-12)
    assert np.abs(lied._suspected.modes).max() > 1e-4


@pytest.mark.long
@pytest.mark.parametrize('duration', [0.03, 0.06, 0.1, 0.2])
@pytest.mark.parametrize('size', [0.008, 0.03, -0.2])
def test_estimates_that_lie_for_a_moment_move_nothing(duration, size):
    assert glitch(size, duration).max() < 4.0 * NOISE


def pushed(time):
    """Return the swing of a gondola of 500 kg that 150 N have pushed for 0.3 s from 20 s on."""
    since, rate = max(time - 20.0, 0.0), math.tau * 0.12
    end = min(since, 0.3)
    after = rate * (since - end)
    return BREEZE(time) + 0.3 * (
        0.5 * end ** 2 * math.cos(after) + end / rate * math.sin(after))


@pytest.mark.long
@pytest.mark.parametrize('rate', [50.0, 100.0])
@pytest.mark.parametrize('noise', [0.1 * NOISE, 0.3 * NOISE])
def test_a_push_is_no_lie(noise, rate):
    """It swings by 120 mm; believed 0.25 s late it would be missed by 33 mm."""
    errors = np.abs(Run(pushed, 24.0, rate=rate, noise=noise).errors[round(20.0 * rate):])
    assert errors.max() < 0.018


SWING = sines(*3 * [((0.1 / (math.tau * 0.12), 0.12, 0.0),)])


def kicked(time):
    """Return a gondola to which a strike at 20 s gives 0.1 m/s."""
    return BREEZE(time) + SWING(max(time - 20.0, 0.0))


def test_a_strike_that_was_taken_for_a_lie_teaches_nothing_wrong():
    """At 0.1 m/s a gondola is 37 mm away before it is believed; then it is followed."""
    errors = np.abs(run(kicked, 24.0).errors[1000:])
    assert errors.max() < 0.045 and errors[50:].max() < 0.02


def test_doubted_estimates_that_were_true_reach_the_tones():
    """Predictions in their place would make false tones for a minute."""
    stamps, *values, _ = run(kicked, 24.0).predictor._tones._blocks.T
    expected = np.array([kicked(stamp - 1000.0) - kicked(0.0) for stamp in stamps])
    assert np.abs(np.transpose(values) - expected).max() < 5.0 * NOISE


@pytest.mark.long
def test_an_estimator_that_steps_back_has_stepped_again():
    assert glitch(0.03, 0.4)[1040:].max() < 4.0 * NOISE


@pytest.mark.parametrize(('noise', 'bound'), [(0.0, 1.5), (NOISE, 2.5)])
def test_a_sway_that_begins_after_rest_is_not_exaggerated(noise, bound):
    """At rest, above all without noise, weights mean nothing: they must not count later."""
    begun = Run(lambda time: BREEZE(time) * min(max(time - 40.0, 0.0) / 5.0, 1.0), 60.0,
                noise=noise, published=NOISE)
    assert (begun.rms(40.0, 50.0) < bound * NOISE).all()
    assert (begun.rms(50.0) < NOISE).all()


@pytest.mark.long
@pytest.mark.parametrize('begin', [24.0, 28.0])
@pytest.mark.parametrize(('deviation', 'settling', 'left'), [
    (3e-4, 2.0, 0.004), (1e-3, 2.0, 0.004), (3e-3, 2.0, 0.004), (0.01, 2.0, 0.012),
    (0.1, 6.0, 0.015)])
def test_a_motion_that_comes_back_after_the_estimator_rested_is_not_exaggerated(
        deviation, settling, left, begin):
    """What is held for 13 s says nothing; what comes then is better, and elsewhere."""
    sway, end, learnt = BREEZE, begin + 13.0, run(BREEZE, begin, noise=3e-4)
    predictor, errors = deepcopy(learnt.predictor), []
    random = np.random.default_rng(1)
    for time in np.arange(begin, end + 10.0, 0.02).tolist():
        is_held = time < end
        values = sway(begin if is_held else time) + 3e-4 * random.standard_normal(3) * (
            not is_held)
        variances = Pose(*3 * [(deviation if is_held else 3e-4) ** 2])
        predictor.update(1000.0 + time, Pose(*values.tolist()), variances)
        errors.append(np.subtract(
            predictor.predict(1000.0 + time + HORIZON).position, sway(time + HORIZON)))
    jump = np.abs(np.subtract(sway(end), sway(begin)))
    after = np.abs(errors[round(50.0 * 13.0):])
    assert (after < 1.5 * jump + 0.012).all()
    assert (after[round(50.0 * settling):] < left).all()


@pytest.mark.parametrize('published', [2e-4, 5e-3])
def test_a_wrong_variance_does_no_great_harm(published):
    assert (Run(gusts(1), 45.0, published=published).rms(20.0) < 1.1 * NOISE).all()


def test_a_gap_is_bridged_and_a_long_one_forgotten():
    predictor = Run(BREEZE, 30.0).predictor
    for ahead, bound in ((0.3, 0.002), (0.6, 0.006)):
        error = predictor.predict(predictor.stamp + ahead).position - BREEZE(29.98 + ahead)
        assert np.abs(error).max() < bound
    later = predictor.stamp + 5.0
    predictor.update(later, Pose(0.3, 0.0, 0.0), VARIANCES)
    assert predictor.since == later
    assert predictor.predict(later + 0.1).position == pytest.approx((0.3, 0.0, 0.0), abs=1e-9)


def test_velocity_is_the_derivative_of_position():
    predictor = Run(BREEZE, 15.0).predictor
    for ahead in (0.02, 0.12, 0.151, 0.4, 0.7):
        before, after = (
            predictor.predict(predictor.stamp + ahead + step).position for step in (-1e-5, 1e-5))
        slope = np.subtract(after, before) / 2e-5
        assert predictor.predict(predictor.stamp + ahead).velocity == pytest.approx(
            tuple(slope), abs=1e-6)
