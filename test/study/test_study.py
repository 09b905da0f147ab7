"""Command of the study: its parts, its files and its messages."""

from itertools import product
import json
from math import dist, radians
from pathlib import Path
import sys

from mechanism import DESIGN, NO_GAP
import numpy as np
import pytest
from pytest import approx

from facade_manipulator.errors import LimitError
from facade_manipulator.kinematics import add, Geometry, Mechanism, Pose, subtract
from facade_manipulator.study import __main__ as study
from facade_manipulator.study.drawing import joints_in_mode
from facade_manipulator.study.figures import figure_8, figure_11, FIGURES
from facade_manipulator.study.figures_postures import extremes, figure_12, MODES
from facade_manipulator.study.paper import design
from facade_manipulator.study.paper_tables import Study


def run(arguments):
    try:
        return study.main(arguments.split())
    except SystemExit as stop:  # argparse ends with it
        return stop.code


def numbers(tmp_path, arguments):
    target = tmp_path / 'numbers.json'
    assert run(f'{arguments} --json {target}') == 0
    return json.loads(target.read_text())


def test_table_2_in_json_has_its_keys_and_ratios(tmp_path):
    rows = numbers(tmp_path, '--table2')['table2']
    designs = [(row['l'], row['b']) for row in rows]
    assert designs == [
        (0.15, 0.55),
        (0.2, 0.5),
        (0.25, 0.45),
        (0.3, 0.4),
        (0.352, 0.348),
    ]
    ratios = [round(row['ratio'], 3) for row in rows]
    assert ratios == [0.788, 0.803, 0.834, 0.870, 0.986]
    assert rows[-1]['paper'] == {'area': 0.328, 'ratio': 0.986, 'good_area': 0.323}
    assert all(
        0.0 < row['good_area_section'] < row['area_section'] < row['area_union']
        for row in rows
    )


@pytest.mark.parametrize(
    ('arguments', 'part', 'expected'),
    [
        (
            '--summary',
            'summary',
            {
                'y_min': approx(0.05292, abs=1e-5),
                'theta_max': approx(radians(19.02), abs=2e-4),
                'ratio': approx(0.986, abs=2e-3),
            },
        ),
        (
            '--ranges --y 0.2 --stroke 1.2 --gap 0.02 --l 0.36 --b 0.34',
            'ranges',
            {'x_max': approx(0.6 - 0.34 + (0.36**2 - 0.2**2) ** 0.5)},
        ),
        (
            '--singularity --l 0.25 --b 0.45',
            'beyond_parallel_singularity',
            {'l': 0.25, 'b': 0.45, 'share': approx(0.43, abs=0.05)},
        ),
        pytest.param(
            '--optimise volume --step 0.01',
            'optimum',
            {
                'objective': 'volume',
                'link_length': 0.35,
                'designs': 'l >= b',
                'count': 6,
            },
            marks=pytest.mark.realtime,
        ),
    ],
)
def test_study_numbers_follow_the_options(tmp_path, capsys, arguments, part, expected):
    found = numbers(tmp_path, arguments)[part]
    row = found if isinstance(found, dict) else found[0]
    assert {key: row[key] for key in expected} == expected
    assert ('beyond N = 0 [%]' in capsys.readouterr().out) == (part == 'optimum')


@pytest.mark.long
def test_every_figure_is_drawn(tmp_path):
    target = tmp_path / 'deep' / 'report'
    assert run(f'--figures {target}') == 0
    assert sorted(path.name for path in target.iterdir()) == sorted(FIGURES)
    for path in target.iterdir():
        assert path.read_bytes().startswith(b'\x89PNG')
        assert path.stat().st_size > 20_000


@pytest.mark.parametrize(
    ('arguments', 'part', 'key', 'is_null'),
    [
        ('--table2 --stroke 0.8', 'table2', 'ratio', [True] + [False] * 4),
        (
            '--singularity --l 0.2 --b 0.5 --stroke 0.1',
            'beyond_parallel_singularity',
            'share',
            [True],
        ),
    ],
)
def test_share_of_an_empty_workspace_is_null(tmp_path, arguments, part, key, is_null):
    rows = numbers(tmp_path, arguments)[part]
    assert [row[key] is None for row in rows] == is_null


NO_HOME = 'the home positions -0.1, 0.1, 0 m are not within the reach of this design'
NO_SECTION = 'the workspace is empty at theta = 0: stroke 0.3 m'


@pytest.mark.parametrize(
    ('design', 'causes'),
    [
        ('--l 0.3 --b 0.4 --stroke 0.5', {'12_compensation': NO_HOME}),
        ('--l 0.6 --b 0.1', {'12_compensation': NO_HOME}),
        (
            '--l 0.2 --b 0.5 --stroke 0.3',
            {
                '03_motions': NO_SECTION,
                '05_working_modes': NO_SECTION,
                '09_conditioning': NO_SECTION,
                '11_ranges': NO_SECTION,
                '12_compensation': NO_HOME,
            },
        ),
    ],
)
@pytest.mark.filterwarnings('error')
def test_figures_that_a_design_lacks_are_named(
    tmp_path, monkeypatch, capsys, design, causes
):
    wanted = {f'figure_{name}.png' for name in [*causes, '12_compensation']}
    drawn = 'figure_07_singular_configurations.png'
    for name in {*FIGURES} - wanted - {drawn}:
        monkeypatch.delitem(FIGURES, name)
    assert run(f'--figures {tmp_path} {design}') == 0
    shown = capsys.readouterr().err
    for name, cause in causes.items():
        assert f'figure_{name}.png is left out: {cause}' in shown
    assert '; next: ' in shown
    assert [path.name for path in tmp_path.iterdir()] == [drawn]


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('stroke', [0.02, 0.3, 0.8])
def test_cases_without_workspace_leave_their_panel_empty(stroke):
    drawn = figure_8(Study(design(0.352, 0.348, stroke)))
    titles = [panel.get_title() for panel in drawn.axes[:5]]
    is_empty = [title.endswith('nan') for title in titles]
    assert is_empty[0]
    assert not is_empty[4]


def test_ranges_are_drawn_from_zero_to_the_link_length():
    left, right = figure_11(Study(NO_GAP)).axes[-2:]
    for panel in (left, right):
        assert panel.get_xlim() == approx((0.0, 352.0))
        assert panel.get_ylim()[0] == 0.0


def test_compensated_head_is_drawn_in_one_place():
    places = []
    for panel in figure_12(Study(NO_GAP)).axes:
        markers = [line for line in panel.lines if line.get_marker() == 'o']
        opaque = [line.get_xydata()[0] for line in markers if line.get_alpha() == 1.0]
        places.append(np.mean(opaque, axis=0))
    assert len(places) == 3
    assert np.ptp(places, axis=0) == approx(0.0, abs=1e-6)


def test_four_modes_share_the_platform_and_the_link_lengths():
    pose = Pose(0.05, 0.25, radians(8.0))
    at = [joints_in_mode(DESIGN, pose, mode) for mode in MODES]
    carriages = Mechanism(DESIGN).inverse_kinematics(pose)
    assert joints_in_mode(DESIGN, pose)['a1'][0] == approx(carriages.q1)
    for joints, side in product(at, '12'):
        assert joints[f'b{side}'] == approx(at[0][f'b{side}'])
        assert joints[f'a{side}'][1] == 0.0
        assert dist(joints[f'a{side}'], joints[f'b{side}']) == approx(0.352)
    q1 = {round(joints['a1'][0], 6) for joints in at}
    q2 = {round(joints['a2'][0], 6) for joints in at}
    # “+−” is the narrowest mode
    assert len(q1) == len(q2) == 2
    assert max(q1) < 0.05 < min(q2)


@pytest.mark.parametrize(
    'geometry', [DESIGN, NO_GAP, Geometry(0.352, 0.348, (-0.2, 0.3), 0.02)]
)
def test_extremes_are_certified_but_not_a_step_beyond(geometry):
    steps = (Pose(0.0, 0.0, 1e-3), Pose(0.0, 1e-3, 0.0), Pose(1e-3, 0.0, 0.0))
    for pose, step in zip(extremes(geometry), steps, strict=True):
        Mechanism(geometry).certify(subtract(pose, step), min_conditioning=0.0)
        with pytest.raises(LimitError):
            Mechanism(geometry).certify(add(pose, step), min_conditioning=0.0)


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ('--l -0.35 --table2', 'link_length = -0.35 m is below its minimum'),
        ('--ranges --y 0.5', 'y = 0.5 m rejected'),
        ('--ranges --y nan', 'y = nan m rejected'),
        (
            '--ranges --y -0.1',
            'y = -0.1 m rejected: at theta = 0 the head reaches from',
        ),
        ('--summary --l 0.15 --b 0.55 --stroke 0.6', 'the workspace is empty'),
        (
            '--ranges --l 0.2 --b 0.5 --stroke 0.3',
            'the workspace is empty at theta = 0',
        ),
        ('--optimise beauty', "invalid choice: 'beauty'"),
        ('--optimise area --sum 2', 'outside Table 1'),
        ('--table2 --threshold 0', '0 is not a finite number above 0'),
        ('--ranges --json {0}/none/numbers.json', '{0}/none'),
        ('--ranges --json {0}', '{0}'),
        ('--ranges --figures {0}/file', '{0}/file'),
    ],
)
def test_bad_input_exits_with_2_and_writes_nothing(
    arguments, message, tmp_path, capsys
):
    file = tmp_path / 'file'
    file.write_text('mine')
    assert run(f'--json {tmp_path}/numbers.json ' + arguments.format(tmp_path)) == 2
    shown = capsys.readouterr()
    assert message.format(tmp_path) in shown.err
    assert shown.out == ''
    assert list(tmp_path.iterdir()) == [file]
    assert file.read_text() == 'mine'


def test_interrupted_study_keeps_the_old_numbers(tmp_path, monkeypatch, capsys):
    def interrupt(*arguments):
        raise KeyboardInterrupt

    target = tmp_path / 'numbers.json'
    target.write_text('old')
    monkeypatch.setitem(study.PARTS, 'ranges', interrupt)
    assert run(f'--ranges --json {target}') == 130
    assert 'no numbers were written' in capsys.readouterr().err
    assert target.read_text() == 'old'
    assert list(tmp_path.iterdir()) == [target]


def test_missing_cluster_library_is_named(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'distributed', None)
    assert run('--optimise area --scheduler tcp://127.0.0.1:9') == 2
    assert 'install the extra cluster' in capsys.readouterr().err


def test_study_without_options_computes_everything(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(study, 'PARTS', {'ranges': study.PARTS['ranges']})
    monkeypatch.setattr(
        study, '_draw', lambda folder, *others: (folder / 'figure.png').touch()
    )
    assert run('') == 0
    assert sorted(path.name for path in Path('workspace_report').iterdir()) == [
        'figure.png',
        'study.json',
    ]
