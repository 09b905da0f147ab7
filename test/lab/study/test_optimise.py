from functools import partial
import math

import numpy as np
import pytest

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.lab.study.optimise import optimise, sweep_size
from facade_manipulator.lab.study.reach import theta_max, y_range
from facade_manipulator.lab.study.requirements import Requirements, theta_peak
from facade_manipulator.lab.study.section import section_area
from facade_manipulator.lab.study.tables import summarise
from facade_manipulator.lab.study.volume import measure

FREE = {'min_difference': -1.0}  # N = 0 may be anywhere


@pytest.mark.parametrize('objective', ['area', 'good_area'])
def test_along_the_papers_sum_the_areas_peak_where_the_links_are_as_long_as_b(objective):
    found = optimise(objective)
    assert found.link_length == pytest.approx(0.350, abs=2e-5)
    assert found.active[:2] == ('l + b = 0.7 m', 'order of the carriages, l = b - gap')
    assert found.designs == sweep_size(objective, Requirements()) == 251


@pytest.mark.parametrize(('objective', 'lengths', 'best', 'value'), [
    ('ratio', (0.340, 0.356), 0.349, 0.986), ('volume', (0.328, 0.338), 0.332, 0.174)])
def test_along_the_papers_sum_ratio_and_volume_peak_before_that(objective, lengths, best, value):
    found = optimise(objective, Requirements(link_range=lengths, **FREE))
    assert found.link_length == pytest.approx(best, abs=1e-3)
    assert found.merits[objective] == found.value == pytest.approx(value, abs=5e-4)


def test_without_the_sum_the_area_grows_to_the_box():
    found = optimise('area', Requirements(length_sum=0.0))
    assert found.active[:2] == ('l <= 0.4 m', 'order of the carriages, l = b - gap')
    assert found.value > optimise('area').value


@pytest.mark.parametrize('gap', [0.0, 0.02, 0.06])
def test_nothing_of_the_best_workspace_lies_beyond_n_unless_that_is_permitted(gap):
    def beyond(**more):
        need = Requirements(carriage_gap=gap, **more)
        found = optimise('area', need)
        return measure(need.geometry(found.link_length, found.platform_half_length),
                       need.threshold).beyond_share

    assert beyond() < 1e-12
    assert gap == 0.0 or beyond(**FREE) > 0.1


def test_the_optimum_beats_every_design_of_the_sweep():
    need = Requirements(length_sum=0.0, carriage_gap=0.02, stroke_length=0.9, **FREE)
    length, half = np.meshgrid(np.linspace(0.15, 0.4, 60), np.linspace(0.3, 0.55, 60))
    assert optimise('area', need).value >= section_area(
        need.lengths([length, half])).max()


def test_a_requirement_that_binds_is_met_and_named():
    asked = math.radians(25.0)
    found = optimise('area', Requirements(min_theta=asked, **FREE))
    reached = theta_peak(Geometry(found.link_length, found.platform_half_length, carriage_gap=0.0))
    assert reached == pytest.approx(asked, abs=1e-4) and reached >= asked - 1e-9
    assert found.active == ('l + b = 0.7 m', 'min_theta = 0.4363 rad')


@pytest.mark.long
@pytest.mark.parametrize(('length', 'half', 'gap'), [
    (0.352, 0.348, 0.0), (0.352, 0.348, 0.02), (0.25, 0.45, 0.0), (0.34, 0.36, 0.01),
    (0.4, 0.3, 0.02)])
def test_the_peak_angle_is_that_of_the_limits(length, half, gap):
    geometry = Geometry(length, half, carriage_gap=gap)
    lower, upper = y_range(geometry)
    coarse = np.linspace(lower, upper, 400)[1:-1]
    best = max(coarse, key=partial(theta_max, geometry))
    fine = np.linspace(best - 2e-3, best + 2e-3, 400)
    peak = max(theta_max(geometry, y) for y in fine if lower < y < upper)
    found = theta_peak(geometry)
    assert peak - 1e-6 <= found <= peak + 4e-4  # the kink lies between two of the fine ones


@pytest.mark.parametrize(('asked', 'words'), [
    ({'min_theta': 1.2}, r'min_theta = 1.2 rad conflicts .* the most is 0\.6'),
    ({'min_y_travel': 0.4}, r'min_y_travel = 0.4 m conflicts .* the most is 0.35 m'),
    ({'min_theta': math.radians(30.0), 'min_y_travel': 0.345},
     'min_y_travel = 0.345 m and min_theta = 0.5236 rad exclude each other'),
])
def test_infeasible_requirements_are_rejected_with_the_conflict(asked, words):
    with pytest.raises(ParameterError, match=words):
        optimise('area', Requirements(**FREE, **asked))


def test_a_sweep_reports_every_design_as_done():
    done, need = [], Requirements(link_range=(0.340, 0.356))
    optimise('volume', need, done.append)
    assert sum(done) == sweep_size('volume', need) == 17


def test_the_summary_of_the_design_agrees_with_the_design_page():
    summary = summarise(Geometry(carriage_gap=0.0), 0.001, 0.001)
    assert summary['y_min'] == pytest.approx(0.05292, abs=1e-5)
    assert math.degrees(summary['theta_max']) == pytest.approx(19.02, abs=0.01)
    assert summary['ratio'] == pytest.approx(0.986, abs=2e-3)
    with pytest.raises(ParameterError, match='workspace is empty'):
        summarise(Geometry(0.15, 0.55, (-0.3, 0.3), 0.0), 0.001, 0.001)
