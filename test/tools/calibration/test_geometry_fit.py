"""Errors of a foreign machine, fitted to a table of measured head poses."""

import math

import numpy as np
import pytest
from scipy.optimize import approx_fprime, fsolve
import yaml

from facade_manipulator.errors import CalibrationError
from facade_manipulator.kinematics import (
    Carriages,
    compose,
    forward_kinematics,
    Geometry,
    Pose,
)
from facade_manipulator.parameters import from_mapping
from facade_manipulator.tools.calibration.__main__ import main
from facade_manipulator.tools.calibration.geometry_fit import (
    fit_geometry,
    head_differences,
    head_poses,
    Measurements,
    permitted_carriages,
    spread_carriages,
)

pytestmark = pytest.mark.long

DRAWING = Geometry()
NOISE = np.array([1e-4, 1e-4, math.radians(0.02)])
# of 8 mm at the head: links, halves of the platform, carriages, rail, head on the platform
DEVIATIONS = np.repeat([2e-3, 2e-3, 4e-3, 0.01, 4e-3, 0.01], [2, 2, 3, 1, 2, 1])
POSES = spread_carriages(DRAWING, 20)
FRESH = permitted_carriages(DRAWING)[::46]
HEADER = 'q1_mm,q2_mm,q3_mm,x_mm,y_mm,theta_deg'


def foreign_head(errors, carriages):
    """Return the head of a machine whose links are closed as points in the plane [m, m, rad]."""
    link1, link2, half1, half2, *offsets, angle, tool_x, tool_y, tool_angle = errors
    along = np.exp(1j * angle)
    a1, a2, a3 = (np.asarray(carriages) + offsets) * along

    def points(y, theta):
        platform = a3 + 1j * y * along
        direction = np.exp(1j * (theta + angle))
        return platform, direction

    def misses(unknown):
        platform, direction = points(*unknown)
        end_1 = platform - (DRAWING.platform_half_length + half1) * direction
        end_2 = platform + (DRAWING.platform_half_length + half2) * direction
        miss_1 = abs(end_1 - a1) - DRAWING.link_length - link1
        miss_2 = abs(end_2 - a2) - DRAWING.link_length - link2
        return miss_1, miss_2

    _, *drawn = forward_kinematics(DRAWING, Carriages(*carriages))
    y, theta = fsolve(misses, drawn, xtol=1e-12)
    platform, direction = points(y, theta)
    head = platform + (tool_x + 1j * tool_y) * direction
    return head.real, head.imag, theta + angle + tool_angle


def foreign_heads(errors, carriages):
    return np.array([foreign_head(errors, row) for row in carriages])


def measured(errors, seed, carriages=POSES, noise=NOISE):
    heads = foreign_heads(errors, carriages)
    random = np.random.default_rng(seed)
    return Measurements(carriages, heads + noise * random.standard_normal(heads.shape))


def allowed_by_noise(errors, used):
    """Return the RMS error of the head [m, m, rad] allowed by the noise of the used rows."""

    def rates(carriages):
        return approx_fprime(
            errors, lambda shifted: foreign_heads(shifted, carriages).ravel(), 1e-6
        )

    deviations = np.tile(NOISE, len(used))
    to_errors = np.linalg.pinv(rates(used) / deviations[:, None], rcond=1e-6)
    left = (rates(FRESH) @ to_errors) ** 2
    variances = left.sum(axis=1).reshape(-1, 3)
    return np.sqrt(variances.mean(axis=0))


def rms(differences):
    return np.sqrt((differences**2).mean(axis=0))


def test_foreign_machine_with_two_wrong_rows_is_calibrated():
    ratios = []
    before = []
    for seed in range(6):
        random = np.random.default_rng(seed)
        errors = DEVIATIONS * random.standard_normal(11)
        rows = measured(errors, random)
        wrong = sorted(random.choice(20, 2, replace=False))
        rows.heads[wrong[0], 0] += 5e-3
        rows.heads[wrong[1], 1:] += [-2e-3, 0.01]
        found = fit_geometry(DRAWING, rows, NOISE)
        assert np.flatnonzero(found.outliers).tolist() == wrong
        true = foreign_heads(errors, FRESH)
        left = rms(head_differences(true, head_poses(found.geometry, FRESH)))
        ratios.append(left / allowed_by_noise(errors, np.delete(POSES, wrong, axis=0)))
        before.append(rms(head_differences(true, head_poses(DRAWING, FRESH))))
        assert (left[:2] < 3.0 * found.head_deviation[:2]).all()
    assert np.hypot(*np.transpose(before)[:2]).mean() > 5e-3
    assert rms(np.array(ratios)).max() < 1.5


def test_published_deviations_contain_the_errors():
    within = []
    for seed in range(8):
        random = np.random.default_rng(100 + seed)
        errors = 0.3 * DEVIATIONS * random.standard_normal(11)
        found = fit_geometry(DRAWING, measured(errors, random), NOISE)
        within.append(np.abs(found.values - errors) < 2.0 * found.deviations)
    assert 0.85 < np.mean(within) <= 1.0


def test_frame_of_the_instrument_is_found():
    random = np.random.default_rng(3)
    errors = DEVIATIONS * random.standard_normal(11)
    errors[[6, 7]] = 0.0  # frame rail as defined by q3 and the line of the joints
    rows = measured(errors, random)
    frame = (2.0, -1.0, 0.3)

    def in_frame(heads):
        return np.array([compose(Pose(*frame), Pose(*head)) for head in heads])

    rows.heads[:] = in_frame(rows.heads)
    found = fit_geometry(DRAWING, rows, NOISE, has_frame=True)
    assert np.array(found.frame) == pytest.approx(frame, abs=5e-3)
    seen = in_frame(foreign_heads(errors, FRESH))
    expected = head_poses(found.geometry, FRESH, found.frame)
    left = rms(head_differences(seen, expected))
    assert (left < 2.5 * found.head_deviation).all()
    with pytest.raises(CalibrationError, match='--frame'):
        fit_geometry(DRAWING, rows, NOISE)


def shift_of_one_metre(rows, row):
    rows.heads[row, 0] += 1.0


def turn_of_three_radians(rows, row):
    rows.heads[row, 2] += 3.0


def exchanged_carriages(rows, row):
    rows.carriages[row] = rows.carriages[row, [1, 0, 2]]


def heads_in_millimetres(rows, row):
    rows.heads[row, :2] *= 1e3


@pytest.mark.parametrize(
    'spoil',
    [
        shift_of_one_metre,
        turn_of_three_radians,
        exchanged_carriages,
        heads_in_millimetres,
    ],
)
@pytest.mark.parametrize('wrong', [[0], [7], [0, 1, 19]])
def test_frame_is_found_although_rows_are_wrong(spoil, wrong):
    frame = Pose(2.0, 3.0, 0.4)
    heads = head_poses(DRAWING, POSES, frame)
    heads += NOISE * np.random.default_rng(1).standard_normal(heads.shape)
    rows = Measurements(POSES.copy(), heads)
    for row in wrong:
        spoil(rows, row)
    found = fit_geometry(DRAWING, rows, NOISE, has_frame=True)
    assert np.flatnonzero(found.outliers).tolist() == wrong
    assert np.array(found.frame) == pytest.approx(frame, abs=5e-3)


def test_poses_that_do_not_determine_the_head_are_rejected():
    line = np.linspace(-0.1, 0.1, 12)  # the platform only slides along the rail
    carriages = np.add.outer(line, [-0.1, 0.1, 0.0])
    rows = measured(np.zeros(11), 1, carriages)
    with pytest.raises(CalibrationError, match=r'do not determine .*length of link 1'):
        fit_geometry(DRAWING, rows, NOISE)


def test_errors_whose_effects_cancel_are_named():
    found = fit_geometry(DRAWING, measured(np.zeros(11), 2), NOISE)
    assert (
        'platform from B1 to P apart from platform from P to B2' in found.unidentified
    )


def test_noise_larger_than_stated_widens_the_deviations():
    rows = measured(np.zeros(11), 4, noise=3.0 * NOISE)
    found, stated = (
        fit_geometry(DRAWING, rows, noise) for noise in (NOISE, 3.0 * NOISE)
    )
    assert found.scatter == pytest.approx(3.0, rel=0.3)
    assert found.head_deviation == pytest.approx(stated.head_deviation, rel=0.35)


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (
            lambda rows: rows.heads[:3],
            '9 measured values, more than 11 are needed to fit 11 errors',
        ),
        (
            lambda rows: rows.heads * [1e3, 1e3, 1.0],
            '20 of 20 rows contradict the others',
        ),
    ],
)
def test_unusable_tables_are_rejected(change, message):
    rows = measured(np.zeros(11), 0)
    heads = change(rows)
    with pytest.raises(CalibrationError, match=message):
        fit_geometry(DRAWING, Measurements(POSES[: len(heads)], heads), NOISE)


def test_planned_poses_are_permitted_and_far_apart(capsys):
    with pytest.raises(SystemExit):
        main(['poses', '--count', '0'])
    assert main(['poses', '--count', '12']) == 0
    header, *rows = capsys.readouterr().out.split()
    assert header.endswith(HEADER)
    carriages = np.array([row.split(',')[4:7] for row in rows], float)
    distances = np.linalg.norm(carriages[:, None] - carriages, axis=2)
    apart = distances[np.triu_indices(12, 1)]
    assert len(carriages) == 12
    assert apart.min() > 100.0


@pytest.fixture
def table(tmp_path):
    """Return the file of a table of 20 rows, the fourth wrong, and the machine's errors."""
    errors = DEVIATIONS * np.random.default_rng(5).standard_normal(11)
    rows = measured(errors, 6)
    rows.heads[3, 0] += 4e-3
    path = tmp_path / 'poses.csv'
    heads = rows.heads * [1e3, 1e3, math.degrees(1.0)]
    lines = [HEADER]
    for row in np.hstack([1e3 * rows.carriages, heads]):
        lines.append(','.join(f'{value:.6f}' for value in row))
    path.write_text('\n'.join(lines))
    return path, errors


def test_command_prints_errors_and_parameter_lines(table, capsys):
    path, errors = table
    assert main(['geometry', str(path)]) == 0
    report, lines = capsys.readouterr().out.split('Lines for the parameter file:\n')
    assert 'Row 4 contradicts the others (x 4.' in report
    assert 'The rows left out of the fit have an RMS error of x' in report
    written = yaml.safe_load(lines)['/**']['ros__parameters']['geometry']
    assert written['rail_angle'] == pytest.approx(errors[7], abs=3e-4)
    found = from_mapping(Geometry, written)
    left = foreign_heads(errors, FRESH) - head_poses(found, FRESH)
    assert (rms(left) < 3.0 * NOISE).all()


def test_dial_gauge_does_not_determine_x_and_angle(table, tmp_path, capsys):
    path, _ = table
    lines = [line.split(',') for line in path.read_text().splitlines()]
    gauge = tmp_path / 'gauge.csv'
    without_x = [','.join([*cells[:3], cells[4]]) for cells in lines]
    gauge.write_text('\n'.join(without_x))
    assert main(['geometry', str(gauge)]) == 0
    told = capsys.readouterr().out
    assert 'do not determine' in told
    assert 'x of the head on the platform' in told
