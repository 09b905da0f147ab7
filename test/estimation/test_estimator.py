"""The estimator on a gondola of the tests' own: accuracy, honesty, and everything that breaks."""

from functools import cache
import math

from estimator_plant import (
    BETTER,
    CAMERA,
    Day,
    Imu,
    LASERS,
    LINE,
    Range,
    replace,
    run,
    setup_of,
    Wall,
)
import numpy as np
import pytest

SENSORS = {**LASERS, 'fix': BETTER}
LEFT = LASERS['left']
pytestmark = pytest.mark.long


def rms(errors):
    return np.sqrt((errors ** 2).mean(axis=0))


@cache
def day(seed=2, duration=36.0, **changes):
    return Day(duration, seed, **changes)


def result(sensors=SENSORS, since=10.0, until=math.inf, **options):
    """Return root mean squares, the worst, and the share within two deviations."""
    outcome = run(options.pop('day', day()), sensors, every=4, **options)
    errors, deviations = outcome.errors(since, until)
    return outcome, rms(errors), np.abs(errors).max(axis=0), (
        np.abs(errors) < 2.0 * deviations).mean(axis=0)


@pytest.mark.parametrize(('fix', 'bound'), [(CAMERA, 0.75), (BETTER, 0.5), (LINE, 0.27)])
def test_gusts_are_estimated_well_and_honestly(fix, bound):
    _, found, _, inside = result({**LASERS, 'fix': fix}, day=day(1))
    assert (found < (bound, 0.2, 0.02)).all()
    assert (inside > (0.85, 0.93, 0.9)).all()


def test_a_platform_that_tilts_with_its_cables_is_estimated_as_well():
    _, found, _, _ = result(day=day(tilting=True, strength=1.5))
    assert (found < (0.5, 0.2, 0.02)).all()


def test_without_a_fix_x_gets_worse_and_says_so_and_y_does_not():
    gaps = {(18.0, 18.5): 2.0, (25.0, 30.0): 60.0, (36.0, 38.0): 12.0}  # s: mm at worst
    lost = replace(BETTER, lost=(*gaps,))
    outcome, *_ = result({**LASERS, 'fix': lost}, day=day(duration=45.0))
    for (begin, end), worst in gaps.items():
        errors, deviations = outcome.errors(begin, end + 0.3)
        assert np.abs(errors[:, 0]).max() < worst
        assert (np.abs(errors) < 4.0 * deviations).all()
        assert rms(errors)[1] < 0.2 and rms(outcome.errors(end + 2.0, end + 4.5)[0])[0] < 0.5


def test_x_that_is_lost_for_good_is_given_up_and_found_again():
    lost = replace(BETTER, lost=((20.0, 40.0),))
    outcome, *_ = result({**LASERS, 'fix': lost}, day=day(duration=50.0))
    reasons = [event.reason for event in outcome.estimator.events if event.subject == 'x']
    assert reasons == ['start by fix', 'nothing has been measured of it for too long',
                       'start by fix']
    assert rms(outcome.errors(43.0)[0])[0] < 0.75  # of five seeds 0.5 to 1.1


@pytest.mark.parametrize(('changes', 'bounds'), [
    ({'left': replace(LEFT, lost=((20.0, 35.0),))}, (0.5, 0.5, 0.03)),
    ({name: replace(one, panes=0.5) for name, one in LASERS.items()}, (0.5, 0.2, 0.02)),
    ({'left': replace(LEFT, step=(20.0, 5e-3))}, (0.5, 0.3, 0.03)),
    ({'fix': replace(BETTER, step=(20.0, 0.3))}, (1.0, 0.2, 0.02))])
def test_a_sensor_that_fails_is_no_catastrophe(changes, bounds):
    _, found, _, _ = result({**SENSORS, **changes}, day=day(duration=45.0))
    assert (found < bounds).all()


@pytest.mark.parametrize('late', [-0.01, 0.02])
def test_pushes_show_how_late_the_stamps_of_a_fix_are(late):
    sensors = {**LASERS, 'fix': replace(BETTER, stamp_error=late)}
    setup = setup_of(sensors, Imu())
    setup = replace(setup, fixes={'fix': replace(
        setup.fixes['fix'], delay=0.005, delay_error=0.01)})
    outcome, *_ = result(sensors, setup=setup, day=day(pushes=(10.0, 16.0, 22.0, 28.0, 34.0)))
    found, deviation = outcome.estimator.delays()['fix']
    assert abs(found - late) < 4e-3 and deviation < 5e-3


def test_transoms_that_pass_are_a_level():
    outcome, found, worst, _ = result(
        day=day(hoisting=0.2, duration=60.0), wall=Wall(2, transom=0.03))
    assert (found < (0.5, 0.3, 0.02)).all() and worst[1] < 2.0
    assert outcome.estimator.records['left'].counts['other level'] > 50
    covariances = np.array(outcome.covariances)  # a part that is not symmetric grows without end
    assert np.allclose(covariances, covariances.transpose(0, 2, 1), rtol=1e-9, atol=1e-20)


def test_without_an_imu_it_is_worse_and_a_push_does_not_end_it():
    _, found, worst, _ = result(imu=None, day=day(pushes=(20.0,)))
    assert (found < (2.0, 0.3, 0.05)).all() and worst[0] < 15.0


@pytest.mark.parametrize('until', [20.2, 28.0, 99.0])
def test_an_imu_that_is_silent_is_named_and_made_up_for(until):
    outcome, *_ = result(imu=Imu(silent=((20.0, until),)))
    assert rms(outcome.errors(20.0, 35.0)[0])[0] < 1.0
    events = [event.reason for event in outcome.estimator.events if event.subject == 'imu']
    assert events[1].startswith('silent for 0.1') and (len(events) == 3) == (until < 36.0)


def test_an_estimator_of_the_pose_and_an_imu_are_enough():
    outcome, *_ = result({'camera': Range('pose', 30.0, 0.05, 1e-3, 0.0)})
    errors, _ = outcome.errors(offsets=True)
    assert (rms(errors) < (0.7, 0.7, 0.03)).all()


def test_swapped_sides_are_a_fault_and_nothing_is_estimated_from_then_on():
    swapped = {'left': LASERS['right'], 'right': LEFT, 'fix': BETTER}
    outcome = run(day(), swapped, setup=setup_of(SENSORS, Imu()), every=4)
    assert 'swapped' in outcome.estimator.fault
    assert max(outcome.stamps) < 15.0


def test_stamps_out_of_order_doubled_or_spoilt_do_no_harm():
    def spoil(events):
        random = np.random.default_rng(5)
        events = [event for event in events for _ in range(1 + (random.random() < 0.05))]
        return [(a, name, s + 5.0 if random.random() < 0.01 else s,
                 math.nan if random.random() < 0.01 and name == 'left' else v)
                for a, name, s, v in events]

    outcome, found, _, _ = result(spoil=spoil)
    assert {'not_finite', 'future', 'out_of_order'} <= set(outcome.rejections)
    assert (found < (0.6, 0.25, 0.02)).all()


def test_a_wall_that_is_known_makes_the_estimate_one_of_the_facade():
    setup = setup_of(SENSORS, Imu(), distance=0.45)
    known = replace(setup, fixes={'fix': replace(
        setup.fixes['fix'], feature=0.1, feature_known=True)})
    errors, _ = run(day(), SENSORS, setup=known, every=4).errors(offsets=True)
    assert (np.abs(np.median(errors, axis=0)) < (0.5, 0.5, 0.03)).all()
