"""The errors of a machine, found from its head."""

import csv
from dataclasses import replace
import sys

from made_up_machines import make_machine, measure_heads, NOISE
import numpy as np
import pytest

from facade_manipulator import parameter_file
from facade_manipulator.errors import CalibrationError, LimitError, ParameterError
from facade_manipulator.kinematics import Carriages, compose, Geometry, mechanism_of, Pose
from facade_manipulator.lab.gondola.course import rms
from facade_manipulator.resources import config_path
from facade_manipulator.tools.calibration.__main__ import main
from facade_manipulator.tools.calibration.design import (
    candidates,
    choose,
    information,
    Noise,
    plan,
    spread,
)
from facade_manipulator.tools.calibration.geometry_fit import (
    identify,
    Measurements,
    report_geometry,
)
from facade_manipulator.tools.calibration.plan_file import fill, goals, read_measured, write_plan
from facade_manipulator.tools.calibration.target import Sought, Target
from facade_manipulator.tools.calibration.unknowns import (
    BACKLASH,
    heads,
    screw_unknowns,
    UNKNOWNS,
    unknowns_named,
    values_of,
    with_instrument,
    with_screw_tables,
    with_values,
)

pytestmark = pytest.mark.long

DRAWING = Geometry()
POSES = plan(DRAWING, UNKNOWNS, 24)
MADE = make_machine(DRAWING, np.random.default_rng(5))


def measured(noise=NOISE, seed=6):
    return measure_heads(MADE, POSES, np.random.default_rng(seed), noise)


def geometry_in(path):
    return parameter_file.read_settings([path], parameter_file.ALL_NODES, 'geometry', Geometry)


def test_made_up_machines_are_found_within_their_deviations_and_their_heads_with_them():
    random, permitted = np.random.default_rng(1), candidates(DRAWING)
    off, blamed, left = [], 0, []
    for _ in range(12):
        made = make_machine(DRAWING, random)
        held = permitted[random.choice(len(permitted), 60, replace=False)]
        found = identify(
            DRAWING, UNKNOWNS, Measurements(POSES, measure_heads(made, POSES, random)))
        off.append((found.values - values_of(made, UNKNOWNS)) / np.sqrt(np.diag(found.covariance)))
        blamed += len(found.outliers)
        truth = heads(made, held)
        left.append([rms(truth - heads(DRAWING, held)), rms(truth - heads(found.geometry, held)),
                     rms(spread(found.geometry, UNKNOWNS, found.covariance, held))])
    before, after, share = rms(np.array(left))
    assert (np.abs(off) < 3.0).mean() >= 0.99 and blamed <= 1
    assert (after < 1.5 * share).all() and (after < 0.1 * before).all()


def test_without_noise_the_machine_is_found_exactly():
    found = identify(DRAWING, UNKNOWNS, Measurements(POSES, measured((0.0, 0.0, 0.0))),
                     Noise(position=1e-6, angle=3e-6))
    assert heads(found.geometry, POSES) == pytest.approx(heads(MADE, POSES), abs=2e-7)
    assert found.unidentified == []
    assert found.values == pytest.approx(values_of(MADE, UNKNOWNS), abs=5e-5)


def test_what_can_not_be_known_apart_is_named():
    found = identify(DRAWING, UNKNOWNS, Measurements(POSES, measured()))
    assert len(found.unidentified) == 1
    assert {'platform from B1 to P', 'x of the head on the platform'} <= set(
        found.unidentified[0])
    less = unknowns_named(['link_errors', 'carriage_offsets', 'rail_angle', 'tool.1'])
    assert identify(DRAWING, less, Measurements(POSES, measured())).unidentified == []


@pytest.mark.parametrize(('row', 'axis', 'error'), [(3, 0, 0.002), (11, 1, -0.001), (20, 2, 0.01)])
def test_a_measurement_that_contradicts_the_rest_is_found_and_left_out(row, axis, error):
    spoilt = measured()
    spoilt[row, axis] += error
    found = identify(DRAWING, UNKNOWNS, Measurements(POSES, spoilt))
    assert found.outliers == [(row, axis)]
    assert heads(found.geometry, POSES) == pytest.approx(heads(MADE, POSES), abs=4e-4)


@pytest.mark.parametrize(('columns', 'names'), [
    ((1,), ['tool.1', 'link_errors']), ((0, 1), ['link_errors', 'tool.1', 'rail_angle'])])
def test_one_number_of_a_dial_gauge_or_two_of_a_camera_are_enough_for_less(columns, names):
    unknowns = unknowns_named(names)
    made = with_values(DRAWING, unknowns, values_of(MADE, unknowns))
    full = measure_heads(made, POSES, np.random.default_rng(7))
    part = np.full_like(full, np.nan)
    part[:, columns] = full[:, columns]
    found = identify(DRAWING, unknowns, Measurements(POSES, part))
    off = (found.values - values_of(made, unknowns)) / np.sqrt(np.diag(found.covariance))
    assert np.abs(off).max() < 3.5
    assert heads(found.geometry, POSES)[:, 1] == pytest.approx(heads(made, POSES)[:, 1], abs=2e-4)


def test_a_slide_out_of_square_and_a_bowed_rail_are_found_or_named_as_not_determined():
    made = replace(MADE, slide_angle=np.deg2rad(0.1), rail_bow=4e-4)
    full = measure_heads(made, POSES, np.random.default_rng(7))
    found, everywhere = identify(DRAWING, UNKNOWNS, Measurements(POSES, full)), candidates(DRAWING)
    off = (found.values - values_of(made, UNKNOWNS)) / np.sqrt(np.diag(found.covariance))
    assert np.abs(off).max() < 3.5 and not found.kept
    without = identify(DRAWING, [one for one in UNKNOWNS if one.field != 'rail_bow'],
                       Measurements(POSES, full))
    after, before = (rms(heads(machine, everywhere) - heads(made, everywhere)) for machine in (
        found.geometry, without.geometry))
    assert (after < 0.5 * before).all()
    assert without.scatter > 1.5 * found.scatter
    widened = np.sqrt(np.diag(without.covariance) / np.diag(found.covariance)[:-1])
    assert (widened > 1.2).all()
    full[:, [0, 2]] = np.nan  # of a dial gauge
    blind = identify(DRAWING, UNKNOWNS, Measurements(POSES, full))
    assert 'slide_angle' in [one.field for one in blind.kept]
    assert blind.geometry.slide_angle == 0.0
    line, = (one for one in report_geometry(blind, None) if one.startswith('not determined'))
    assert 'squareness of the middle slide (slide_angle)' in line


STANDS = Pose(0.005, -0.003, np.deg2rad(0.3))


def in_frame(poses, frame):
    return [compose(frame, Pose(*pose)) for pose in poses]


def test_an_instrument_that_stands_somewhere_is_found_with_the_machine():
    made = replace(MADE, rail_angle=0.0, carriage_offsets=(*MADE.carriage_offsets[:2], 0.0))
    true = measure_heads(made, POSES, np.random.default_rng(6))
    seen = Measurements(POSES, np.array(in_frame(true, STANDS)))
    found = identify(*with_instrument(DRAWING, UNKNOWNS), seen)
    off = found.values[-3:] - STANDS
    assert (np.abs(off) < 3.5 * np.sqrt(np.diag(found.covariance))[-3:]).all()
    everywhere, taken = candidates(DRAWING), identify(DRAWING, UNKNOWNS, seen).geometry
    truth = np.array(in_frame(heads(made, everywhere), STANDS))
    error, worse = (rms(heads(machine, everywhere) - truth) for machine in (
        found.geometry, taken))
    assert (error < [1e-4, 1e-4, 3e-4]).all()
    assert worse[1] > 2.0 * error[1]


@pytest.mark.parametrize('row', [4, 12, 20])
def test_a_knocked_instrument_is_named_and_no_good_row(row):
    spoilt = measured()
    spoilt[row:] = in_frame(spoilt[row:], Pose(0.002, -0.001, 0.002))
    with pytest.raises(CalibrationError, match=f'from row {row + 1} on .* instrument knocked'):
        identify(DRAWING, UNKNOWNS, Measurements(POSES, spoilt))


def test_planned_poses_show_more_than_as_many_at_random():
    permitted = candidates(DRAWING)
    rows = information(DRAWING, UNKNOWNS, permitted, Noise())

    def worth(chosen):
        return np.linalg.slogdet(np.eye(len(UNKNOWNS)) + sum(
            rows[k].T @ rows[k] for k in chosen))[1]

    best, random = choose(rows, 24), np.random.default_rng(2)
    assert len(set(best)) == 24
    assert worth(best) > 2.0 + max(
        worth(random.choice(len(rows), 24, replace=False)) for _ in range(20))


def test_every_planned_pose_is_permitted_even_to_a_machine_with_errors():
    for carriages in POSES.tolist():
        mechanism_of(MADE).check(Carriages(*carriages))


def with_screws(machine, random):
    """Return the machine with screws that are uneven and have play."""
    return replace(machine, backlash=tuple(random.uniform(0.0, 3e-4, 3).tolist()), **{
        f'screw_errors_{name}': tuple((1e-4 * random.standard_normal(5)).tolist())
        for name in Carriages._fields})


def test_tables_of_the_screws_and_their_backlash_are_found_with_the_rest():
    drawing, random = with_screw_tables(DRAWING, 5), np.random.default_rng(3)
    unknowns = (*UNKNOWNS, *BACKLASH, *screw_unknowns(drawing))
    poses = plan(drawing, unknowns, 48)
    assert set(poses[:, 3]) == {-1.0, 1.0}
    held = candidates(drawing)[::9]
    held = np.column_stack([held, np.resize([1.0, -1.0], len(held))])
    for _ in range(3):
        made = with_screws(make_machine(drawing, random), random)
        found = identify(drawing, unknowns, Measurements(
            poses, measure_heads(made, poses, random)))
        deviations = np.sqrt(np.diag(found.covariance))
        assert (np.abs(found.values - values_of(made, unknowns)) < 3.5 * deviations).all()
        assert (deviations[13:16] < 6e-5).all()
        left = rms(heads(made, held) - heads(found.geometry, held))
        assert (left < 2.0 * rms(spread(found.geometry, unknowns, found.covariance, held))).all()
        assert (left < 0.2 * rms(heads(made, held) - heads(DRAWING, held))).all()


def test_backlash_is_not_found_without_the_direction_of_arrival():
    with pytest.raises(CalibrationError, match='no row says in which direction'):
        identify(DRAWING, (*UNKNOWNS, *BACKLASH), Measurements(POSES, measured()))


def test_a_table_of_a_screw_says_the_same_with_more_entries():
    coarse = replace(DRAWING, screw_errors_q1=(1e-4, -1e-4, 0.0))
    fine = with_screw_tables(coarse, 5)
    assert fine.screw_errors_q1 == pytest.approx((1e-4, 0.0, -1e-4, -5e-5, 0.0))
    assert fine.screw_errors_q2 == (0.0,) * 5
    assert heads(fine, POSES) == pytest.approx(heads(coarse, POSES), abs=1e-12)
    with pytest.raises(ParameterError, match='2 are the least'):
        with_screw_tables(coarse, 1)


def test_too_few_poses_are_rejected():
    with pytest.raises(CalibrationError, match='too few poses: 9 measured numbers for 13'):
        identify(DRAWING, UNKNOWNS, Measurements(POSES[:3], measured()[:3]))


def test_the_measurements_of_another_machine_are_rejected():
    random = np.random.default_rng(9)
    for wrong in (measured() + 0.002 * random.standard_normal((24, 3)),
                  measured() + 0.03 * (random.random((24, 3)) < 0.4)):
        with pytest.raises(CalibrationError, match='contradict'):
            identify(DRAWING, UNKNOWNS, Measurements(POSES, wrong))


def test_carriages_at_which_no_machine_closes_are_named():
    with pytest.raises(LimitError):
        measure_heads(MADE, np.array([[-0.5, 0.5, 0.0]]), np.random.default_rng(0))
    far = POSES.copy()
    far[2] = -0.5, 0.5, 0.0
    with pytest.raises(CalibrationError, match='row 3: the links do not close'):
        identify(DRAWING, UNKNOWNS, Measurements(far, measured()))


@pytest.fixture
def table(tmp_path):
    """Return how to write a table of measurements, changed as one likes."""
    def write(change=lambda rows: rows):
        rows = [['q1', 'q2', 'q3', 'x_mm', 'y_mm', 'theta_deg']]
        rows += [[*q, x * 1e3, y * 1e3, np.rad2deg(theta)]
                 for q, (x, y, theta) in zip(POSES.tolist(), measured().tolist(), strict=True)]
        path = tmp_path / 'measured.csv'
        with path.open('w', newline='') as file:
            csv.writer(file).writerows(change(rows))
        return path

    return write


def test_the_command_writes_a_copy_with_the_errors_and_every_comment(table, tmp_path, capsys):
    target, picture = tmp_path / 'calibrated.yaml', tmp_path / 'accuracy.png'
    assert main(
        ['geometry', str(table()), '--output', str(target), '--picture', str(picture)]) == 0
    said = capsys.readouterr().out
    assert 'length of link 1' in said and 'held-out poses' in said
    before, after = (
        path.read_text().splitlines() for path in (config_path('manipulator.yaml'), target))
    new = [line.split(':')[0].strip() for line in after if line not in before]
    assert new == ['link_errors', 'platform_errors', 'carriage_offsets', 'rail_angle', 'tool',
                   'slide_angle', 'rail_bow']
    assert [line for line in after if line in before] == before
    assert heads(geometry_in(target), POSES) == pytest.approx(heads(MADE, POSES), abs=4e-4)
    assert picture.read_bytes().startswith(b'\x89PNG')


def test_the_command_finds_the_frame_of_the_instrument_and_writes_none_of_it(
        table, tmp_path, capsys):
    target = tmp_path / 'calibrated.yaml'
    assert main(['geometry', str(table()), '--frame', '--output', str(target)]) == 0
    assert "angle of the rail in the instrument's frame" in capsys.readouterr().out
    assert 'instrument' not in target.read_text()
    assert geometry_in(target).rail_angle == 0.0 != geometry_in(target).tool[1]
    assert main(['geometry', '--frame', '--plan', str(tmp_path / 'p.csv'), '--count', '9']) == 0


ON_HEAD = np.array([[0.08, 0.01], [-0.08, 0.0], [0.0, 0.1]])  # m


@pytest.mark.parametrize('count', [2, 3])
def test_points_on_the_head_show_as_much_wherever_the_instrument_stands(
        table, tmp_path, capsys, count):
    target, random, far = tmp_path / 'a.yaml', np.random.default_rng(4), Pose(3.0, -2.0, 3.0)
    on_head = [f'{1e3 * one:g}' for one in ON_HEAD[:count].flat]

    def points(rows):
        seen = [[compose(head, Pose(*one, 0.0))[:2] for one in ON_HEAD[:count]]
                for head in in_frame(heads(MADE, POSES), far)]
        names = [f'{axis}{k}_mm' for k in range(1, count + 1) for axis in 'xy']
        return [[*rows[0][:3], *names]] + [
            [*row[:3], *(1e3 * (np.array(one).ravel() + 5e-5 * random.standard_normal(2 * count)))]
            for row, one in zip(rows[1:], seen, strict=True)]

    options = ['--frame', '--noise', '0.05', '0.02', '--points', *on_head]
    assert main(['geometry', str(table(points)), *options, '--output', str(target)]) == 0
    own = replace(MADE, rail_angle=0.0, carriage_offsets=tuple(
        one - MADE.carriage_offsets[2] for one in MADE.carriage_offsets))
    off = heads(geometry_in(target), POSES) - heads(own, POSES)
    assert (off.std(axis=0) < [1e-4, 1e-4, 5e-4]).all()  # but for where frame rail is
    spoilt = table(lambda rows: cell(4, 3, points(rows)[4][3] + 2.0)(points(rows)))
    assert main(['geometry', str(spoilt), *options]) == 1
    assert 'row 4: the points do not lie as on the head' in capsys.readouterr().err
    assert main(['geometry', '--plan', str(tmp_path / 'p.csv'), '--points', '80', '0']) == 1
    assert '2 numbers are not x and y of two or three' in capsys.readouterr().err
    assert main(['measure', str(spoilt), '--topic', '--points', *on_head]) == 1
    assert 'leave out --points, or --topic' in capsys.readouterr().err


def test_a_row_of_a_plan_is_filled_once(tmp_path, capsys):
    path, station = tmp_path / 'poses.csv', (-0.1, 0.1, 0.0, 1.0)
    command = ['geometry', '--plan', str(path), '--count', '12', '--measure', 'x', 'y']
    assert main(command) == 0
    fill(path, 3, station, ('x', 'y'), (0.1, np.nan))
    carriages, seen = read_measured(path, Sought(DRAWING, target=Target(['x', 'y'])))
    assert tuple(carriages[3]) == station and seen[3, 0] == 0.1 and np.isnan(seen).sum() == 38
    with pytest.raises(CalibrationError, match='row 4 of .* has measured values meanwhile'):
        fill(path, 3, station, ('x', 'y'), (0.2, 0.3))
    assert read_measured(path, Sought(DRAWING, target=Target(['x', 'y']))).heads[3, 0] == 0.1
    assert main(command) == 1
    assert 'has measured values or is no plan: nothing is written' in capsys.readouterr().err
    path.write_text('')
    with pytest.raises(CalibrationError, match='poses.csv is no plan .* it has no rows'):
        goals(path, ('x', 'y'))


def test_the_command_reads_what_is_typed_into_its_plan(tmp_path, monkeypatch, capsys):
    path = tmp_path / 'poses.csv'
    assert main(['geometry', '--plan', str(path), '--count', '12']) == 0
    with path.open() as file:
        rows = list(csv.DictReader(file))
    carriages = np.array([[float(row[name]) for name in ('q1', 'q2', 'q3')] for row in rows])
    found = measure_heads(MADE, carriages, np.random.default_rng(8))
    for row, head in zip(rows, found.tolist(), strict=True):
        row.update(zip(('x', 'y', 'theta'), head, strict=True))
    typed = [list(rows[0]), *(map(str, row.values()) for row in rows)]
    monkeypatch.setattr(sys, 'stdin', [','.join(line) + '\n' for line in typed])
    assert main(['geometry', '-']) == 0
    assert len(rows) == 13 and rows[0]['q1'] == rows[-1]['q1']
    assert 'scatter' in capsys.readouterr().out


def test_a_dial_gauge_is_enough_for_what_it_shows(table, tmp_path):
    target = tmp_path / 'calibrated.yaml'
    only_y = table(lambda rows: [[*row[:3], '', row[4], ''] if k else row
                                 for k, row in enumerate(rows)])
    find = ['--find', 'tool.1', 'link_errors', 'carriage_offsets', 'rail_angle']
    assert main(['geometry', str(only_y), *find, '--output', str(target)]) == 0
    off = heads(geometry_in(target), POSES) - heads(MADE, POSES)
    assert np.abs(off[:, 1]).max() < 5e-4
    assert main(['geometry', str(only_y), '--noise', '0.001', '0.02']) == 1


def test_what_commissioning_found_is_kept_or_the_command_writes_nothing(
        table, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    machine, shipped = tmp_path / 'machine.yaml', str(config_path('manipulator.yaml'))
    drives = {'q2': {'direction': -1, 'lead': 0.01, 'serial_number': 4712}}
    parameter_file.write_parameters(config_path('manipulator.yaml'), machine, 'driver', drives)
    before = machine.read_text()
    for target in ('machine.yaml', 'calibrated.yaml'):
        assert main(['geometry', str(table()), '--parameters', shipped, '--output', target]) == 1
        assert '(q2.direction, q2.lead, q2.serial_number): nothing' in capsys.readouterr().err
    assert machine.read_text() == before and not (tmp_path / 'calibrated.yaml').exists()
    assert main(['geometry', str(table()), '--output', 'machine.yaml']) == 0
    assert parameter_file.read_parameters([machine], 'driver')['q2.direction'] == -1
    assert heads(geometry_in(machine), POSES) == pytest.approx(heads(MADE, POSES), abs=4e-4)


@pytest.mark.parametrize('spoil', [
    lambda head, first: f'{head.replace(",y,", ",y_mm,")}\n{first[:-1]}0.01\n',
    lambda head, first: f'{head},\n{first},0.01\n',  # in a column without a title
    lambda head, first: f'{head}\n{first},0.01\n',
    lambda head, first: f'{head}\n{first}\n# y = 0.01\n',
    lambda head, first: 'q1,q2,q3\n0.1,0.2,0.3\n',
    lambda head, first: 'machine: {}\n',
    lambda head, first: '',
])
def test_a_plan_takes_the_place_of_nothing_but_a_plan_without_measurements(tmp_path, spoil):
    path = tmp_path / 'poses.csv'
    for _ in range(2):
        assert write_plan(path, Sought(DRAWING), POSES[:4]) == 5
    path.write_text(spoil(*path.read_text().splitlines()[:2]))
    before = path.read_text()
    with pytest.raises(CalibrationError, match='has measured values or is no plan: nothing is w'):
        write_plan(path, Sought(DRAWING), POSES[:4])
    assert path.read_text() == before


def test_the_command_plans_for_the_screws_and_writes_their_errors(tmp_path, capsys):
    path, target = tmp_path / 'poses.csv', tmp_path / 'calibrated.yaml'
    screws = ['--backlash', '--screws', '3']
    assert main(['geometry', '--plan', str(path), '--count', '40', *screws]) == 0
    carriages, random = read_measured(path, Sought(DRAWING)).carriages, np.random.default_rng(1)
    for row, head in enumerate(measure_heads(make_machine(DRAWING, random), carriages, random)):
        fill(path, row, carriages[row], Pose._fields, head)
    assert main(['geometry', str(path), *screws, '--output', str(target)]) == 0
    found, said = geometry_in(target), capsys.readouterr().out
    assert len(found.screw_errors_q2) == 3 and max(found.backlash) < 2e-4
    assert 'backlash of the screw of q3' in said and 'screw of q1, error at +0.500 m' in said
    path.write_text(path.read_text().replace(',1.000000,', ',2,'))
    assert main(['geometry', str(path), *screws]) == 1
    assert 'row 1: direction = 2 is not 1, -1 or 0' in capsys.readouterr().err


def cell(row, column, value):
    def change(rows):
        rows[row][column] = value
        return rows

    return change


@pytest.mark.parametrize(('change', 'message'), [
    (cell(4, 1, ''), 'row 4 (line 5): q2 is missing'),
    (cell(4, 4, 'about 250'), "row 4 (line 5): y_mm = 'about 250' is not a number"),
    (cell(0, 4, 'y'), 'if it is in mm, name the column y_mm'),
    (cell(0, 5, 'theta'), 'if it is in deg, name the column theta_deg'),
    (cell(0, 3, 'x'), 'if it is in mm, name the column x_mm'),
    (cell(0, 4, 'x'), 'has x in two units'),
    (cell(0, 5, 'theta_degrees'), 'theta_degrees is not understood; there are q1, q2,'),
    (cell(0, 3, 'X'), 'column X is not understood'),
    (cell(0, 5, 'angle'), 'column angle is not understood; there are'),
    (lambda rows: [['# a'], *rows[:2], [], *cell(3, 1, '')(rows)[2:]],
     'row 3 (line 6): q2 is missing'),
    (lambda rows: [rows[0], *([*row[:4], row[4] / 1e3, row[5]] for row in rows[1:])],
     'if it is in m, name the column y_m'),
    (cell(0, 2, 'Q'), 'has no column q3'),
    (lambda rows: rows[:1], 'has no rows'),
    (lambda rows: [rows[0]] + rows[1:3] * 8, 'poses that cannot show enough'),
    (lambda rows: cell(9, 4, rows[9][4] + 2.0)(rows), 'some measurements contradict the rest'),
], ids=range(15))
def test_bad_input_is_named_and_nothing_is_written(table, tmp_path, rejected, change, message):
    target = tmp_path / 'calibrated.yaml'
    assert message in rejected(main, ['geometry', str(table(change)), '--output', str(target)])
    assert not target.exists()


def test_notes_and_rows_that_are_not_measured_are_passed_over(table, capsys):
    noted = table(lambda rows: [[*row, 'note_day' if k == 0 else 'Monday'] for k, row in enumerate(
        [*rows[:5], [*rows[5][:3], '', '', ''], *rows[6:]])])
    assert main(['geometry', str(noted)]) == 0
    assert 'rows without a measurement: 5\n' in capsys.readouterr().out


def test_a_table_of_a_spreadsheet_with_decimal_commas_says_the_same(table, tmp_path):
    targets = [tmp_path / name for name in ('a.yaml', 'b.yaml')]
    path = table()
    assert main(['geometry', str(path), '--output', str(targets[0])]) == 0
    path.write_text(path.read_text().replace(',', ';').replace('.', ','))
    assert main(['geometry', str(path), '--output', str(targets[1])]) == 0
    assert targets[0].read_text() == targets[1].read_text()


def test_what_cannot_be_planned_or_written_is_named(table, tmp_path, rejected):
    nowhere = tmp_path / 'none'
    for arguments, message in (
            (['--plan', str(nowhere / 'p.csv'), '--count', '1'], 'p.csv cannot be written'),
            (['--plan', str(tmp_path / 'p.csv'), '--count', '0'], '0 poses cannot be planned'),
            (['--plan', str(tmp_path / 'p.csv'), '--screws', '101'], '100 the most'),
            (['--plan', str(tmp_path / 'p.csv'), '--noise', '0', '1'], '--noise: position = 0 m'),
            ([str(table()), '--picture', str(nowhere / 'a.png')], 'a.png cannot be written'),
            ([str(table()), '--output', str(nowhere / 'a.yaml')], 'a.yaml cannot be written')):
        assert message in rejected(main, ['geometry', *arguments])


def test_a_file_that_is_none_is_named(table, tmp_path, rejected):
    for text, message in (('[1', 'cannot be read'), ('- 1', 'not a parameter file'),
                          ('/**: {ros__parameters: {geometry: {wheel: 1}}}', 'geometry')):
        source = tmp_path / 'other.yaml'
        source.write_text(text)
        assert message in rejected(main, ['geometry', str(table()), '--parameters', str(source)])
    assert 'cannot be read' in rejected(main, ['geometry', str(tmp_path / 'none.csv')])


def test_without_scipy_the_command_says_what_to_install(table, monkeypatch, rejected):
    monkeypatch.setitem(sys.modules, 'scipy.optimize', None)
    assert "the extra 'study'" in rejected(main, ['geometry', str(table())])
