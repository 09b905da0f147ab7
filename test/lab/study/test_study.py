import json
import math
from pathlib import Path
import sys

import pytest

from facade_manipulator.kinematics import Geometry
from facade_manipulator.lab.study import study
from facade_manipulator.lab.study.output import folder, json_file


def run(*arguments):
    try:
        return study.main([str(argument) for argument in arguments])
    except SystemExit as stop:  # argparse's own way
        return stop.code


def numbers(tmp_path, *arguments):
    target = tmp_path / 'numbers.json'
    assert run(*arguments, '--json', target) == 0
    return json.loads(target.read_text())


def test_table_2_has_its_keys_and_the_papers_ratios(tmp_path):
    rows = numbers(tmp_path, '--table2')['table2']
    assert [(row['l'], row['b'], round(row['ratio'], 3)) for row in rows] == [
        (0.15, 0.55, 0.788), (0.2, 0.5, 0.803), (0.25, 0.45, 0.834), (0.3, 0.4, 0.870),
        (0.352, 0.348, 0.986)]
    assert set(rows[0]) == {
        'l', 'b', 'ratio', 'area_section', 'good_area_section', 'area_union', 'paper'}
    assert rows[-1]['paper'] == {'area': 0.328, 'ratio': 0.986, 'good_area': 0.323}
    assert all(0.0 < row['good_area_section'] < row['area_section'] < row['area_union']
               for row in rows)


def test_ranges_follow_stroke_gap_and_lengths(tmp_path):
    (row,) = numbers(tmp_path, '--ranges', '--y', 0.2, '--stroke', -0.3, 0.6, '--gap', 0.02,
                     '--l', 0.36, '--b', 0.34)['ranges']
    assert row['x_max'] == pytest.approx(0.6 - 0.34 + math.sqrt(0.36 ** 2 - 0.2 ** 2))
    inputs = json.loads((tmp_path / 'numbers.json').read_text())['inputs']
    assert inputs['stroke'] == [-0.3, 0.6] and inputs['carriage_gap'] == 0.02


def test_without_distances_every_ten_millimetres_of_the_range_are_listed(tmp_path):
    rows = numbers(tmp_path, '--ranges', '--stroke', 1.2)['ranges']
    assert [row['y'] for row in rows] == [step / 100 for step in range(6, 36)]


def test_the_singularity_has_its_keys_for_the_papers_line_and_for_one_design(tmp_path):
    rows = numbers(tmp_path, '--singularity')['beyond_parallel_singularity']
    shares = {row['l']: row['share'] for row in rows}
    assert shares[0.15] == pytest.approx(0.48, abs=5e-3)
    assert shares[0.34] == pytest.approx(0.26, abs=5e-3)
    assert shares[0.35] == pytest.approx(0.0, abs=1e-9)
    (row,) = numbers(tmp_path, '--singularity', '--l', 0.25, '--b', 0.45)[
        'beyond_parallel_singularity']
    assert (row['l'], row['b']) == (0.25, 0.45)


def test_the_optimum_says_what_holds_it(tmp_path, capsys):
    (optimum,) = numbers(tmp_path, '--optimise', 'area')['optimum']
    assert optimum['link_length'] == pytest.approx(0.35, abs=2e-5)
    assert 'l + b = 0.7 m' in optimum['active']
    assert optimum['requirements']['min_difference'] == 0.0
    assert 'l + b = 0.7 m' in capsys.readouterr().out


def test_the_optimum_keeps_the_gap_of_the_machine(tmp_path):
    machine = tmp_path / 'machine.yaml'
    machine.write_text('/**:\n  ros__parameters:\n    geometry:\n      carriage_gap: 0.03\n'
                       '      carriage_length: 0.025\n')
    (optimum,) = numbers(tmp_path, '--optimise', 'area', '--parameters', machine)['optimum']
    assert optimum['requirements']['carriage_gap'] == 0.03
    assert run('--optimise', 'area', '--parameters', machine, '--gap', 0.0) == 2


def test_a_design_is_summed_up_with_a_gap_that_the_optimisers_box_has_no_room_for(tmp_path):
    summary = numbers(tmp_path, '--summary', '--gap', 0.3)['summary']
    assert summary['y_min'] == pytest.approx(math.sqrt(0.352 ** 2 - 0.048 ** 2))


def test_tables_show_their_units(capsys):
    assert run('--table2', '--summary') == 0
    shown = capsys.readouterr().out
    assert 'l [mm]' in shown and 'areas [m2]' in shown and 'm2 rad' in shown


@pytest.mark.long
def test_every_figure_is_drawn_and_nothing_else_is_left(tmp_path):
    from facade_manipulator.lab.study.figures import FIGURES
    target = tmp_path / 'deep' / 'report'
    assert run('--figures', target) == 0
    assert sorted(path.name for path in target.iterdir()) == sorted(FIGURES)
    for path in target.iterdir():
        assert path.read_bytes().startswith(b'\x89PNG') and path.stat().st_size > 20_000


def test_ranges_without_a_gap_are_drawn_of_carriages_that_have_a_length():
    from facade_manipulator.lab.study.figures import figure_11
    from facade_manipulator.lab.study.tables import Study
    machine = Geometry(carriage_gap=0.03, carriage_length=0.025)
    made = figure_11(Study(machine))
    assert [line.get_label() for line in made.axes[3].lines] == ['gap 0 mm', 'gap 30 mm']


@pytest.mark.parametrize(('arguments', 'message'), [
    (('--l', -0.35, '--table2'), 'link_length = -0.35 m is below its minimum'),
    (('--stroke', 0, '--ranges'), 'stroke = 0 m is not a positive length'),
    (('--stroke', 1, 2, 3, '--ranges'), '3 values'),
    (('--ranges', '--y', 0.5), 'y = 0.5 m is out of the workspace'),
    (('--ranges', '--y', 0.05), 'y = 0.05 m is out of the workspace'),
    (('--ranges', '--y', 'nan'), 'y = nan is not a finite number'),
    (('--ranges', '--l', 0.15, '--b', 0.55, '--stroke', 0.6), 'workspace is empty'),
    (('--optimise', 'beauty'), "objective = 'beauty' is not one of"),
    (('--optimise', 'area', '--min-theta', 1.4), 'min_theta = 1.4 rad conflicts'),
    (('--optimise', 'area', '--gap', 0.02, '--carriage-length', 0.03), 'may not stand where they'),
    (('--optimise', 'volume', '--results', '/proc/none'), '/proc/none cannot be written'),
    (('--optimise', 'area', '--designs', 1.5), 'invalid int value'),
    (('--ranges', '--y'), 'expected at least one argument'),
    (('--l', 'long'), 'invalid float value'),
])
def test_bad_input_is_a_sentence_with_exit_status_2_and_writes_nothing(
        arguments, message, tmp_path, capsys):
    assert run(*arguments, '--json', tmp_path / 'numbers.json',
               '--figures', tmp_path / 'report') == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('make', [
    lambda folder: ('--ranges', '--json', folder / 'none' / 'numbers.json'),
    lambda folder: ('--ranges', '--json', folder),
    lambda folder: ('--figures', folder / 'file'),
    lambda folder: ('--figures', folder / 'file' / 'report'),
])
def test_a_place_that_cannot_be_written_is_a_sentence_before_any_work(make, tmp_path, capsys):
    (tmp_path / 'file').write_text('mine')
    assert run(*make(tmp_path)) == 2
    shown = capsys.readouterr()
    assert 'cannot be written' in shown.err and shown.out == ''
    assert [path.name for path in tmp_path.iterdir()] == ['file']
    assert (tmp_path / 'file').read_text() == 'mine'


def test_a_file_of_numbers_stays_as_it_was_when_the_study_fails(tmp_path):
    target = tmp_path / 'numbers.json'
    target.write_text('old')
    with pytest.raises(RuntimeError), json_file(target) as content:
        content['half'] = 'done'
        raise RuntimeError
    assert target.read_text() == 'old' and len(list(tmp_path.iterdir())) == 1


def test_a_folder_keeps_what_it_had_when_the_study_fails(tmp_path):
    (tmp_path / 'figure.png').write_text('old')
    with pytest.raises(RuntimeError), folder(tmp_path) as draft:
        (draft / 'figure.png').write_text('half')
        raise RuntimeError
    assert (tmp_path / 'figure.png').read_text() == 'old'
    with folder(tmp_path) as draft:
        (draft / 'figure.png').write_text('new')
    assert (tmp_path / 'figure.png').read_text() == 'new'
    assert len(list(tmp_path.iterdir())) == 1


def test_an_interrupted_study_says_so_and_writes_nothing(tmp_path, monkeypatch, capsys):
    def interrupt(*arguments):
        raise KeyboardInterrupt
    monkeypatch.setitem(study.PARTS, 'ranges', interrupt)
    assert run('--ranges', '--json', tmp_path / 'numbers.json') == 130
    assert 'nothing was written' in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(('library', 'arguments', 'extra'), [
    ('scipy.stats', ('--designs', 9), 'study'),
    ('distributed', ('--scheduler', 'tcp://127.0.0.1:9'), 'cluster')])
def test_a_missing_library_is_named(monkeypatch, capsys, library, arguments, extra):
    monkeypatch.setitem(sys.modules, library, None)
    assert run('--optimise', 'area', *arguments) == 2
    assert f"extra '{extra}'" in capsys.readouterr().err


def test_the_help_has_examples(capsys):
    assert run('--help') == 0
    shown = capsys.readouterr().out
    assert 'examples:' in shown and '--table2' in shown


def test_with_nothing_asked_for_the_whole_study_goes_into_its_folder(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(study, 'PARTS', {'ranges': study.PARTS['ranges']})
    monkeypatch.setattr(study, '_draw', lambda draft, *others: (draft / 'figure.png').touch())
    assert run() == 0
    report = Path('workspace_report')
    assert sorted(path.name for path in report.iterdir()) == ['figure.png', 'study.json']
