"""Tables in the formats of spreadsheets."""

import numpy as np
import pytest

from facade_manipulator.errors import CalibrationError
from facade_manipulator.tools.calibration.csv_reader import read_table

COLUMNS = ('q1', 'x', 'theta')
PLAIN = 'q1,x_mm,theta,note_1\n0.1,2.5,0.3,good\n-0.2,1250,1e-2,\n'
EXPECTED = [[0.1, 0.0025, 0.3], [-0.2, 1.25, 0.01]]
GERMAN = PLAIN.replace(',', ';').replace('.', ',')


@pytest.mark.parametrize('encoding', ['utf-8', 'utf-8-sig', 'cp1252'])
@pytest.mark.parametrize(
    'text',
    [
        PLAIN,
        GERMAN,
        GERMAN.replace('\n', '\r\n'),
        f'sep=;\n{GERMAN}',
        GERMAN.replace('good', 'für später'),
        GERMAN.replace('\n', '\n;;;\n\n'),
        GERMAN.replace('\n', ';;\n'),
        PLAIN.replace('0.1,2.5', '"0.1","2.5"'),
    ],
)
def test_spreadsheet_table_is_read_in_si_units(tmp_path, text, encoding):
    path = tmp_path / 'table.csv'
    path.write_bytes(text.encode(encoding))
    assert np.allclose(read_table(path, COLUMNS), EXPECTED, atol=0.0)


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('q1,x,theta\n0,1,0,2,0,3\n', 'row 1 rejected: 0, 1, 0'),
        (
            'q1,x,theta\n"0,1","0,2","0,3"\n',
            'row 1 rejected: 0,1, 0,2, 0,3 are not 3 finite numbers',
        ),
        (GERMAN.replace('1250', '1.250,5'), r'row 2 rejected: .* 1\.250\.5'),
        (GERMAN.replace('0,3', '#DIV/0!'), 'row 1 rejected: .*#DIV/0!'),
        (f'{GERMAN};;;\n0,1;;0,3;\n', 'row 3 rejected'),
        (PLAIN.replace('note_1', 'x_m'), 'column x is missing or duplicate'),
        (PLAIN.replace('x_mm', 'x_inch'), 'column x_inch is unknown'),
        (
            PLAIN.replace('theta', 'theta_mm'),
            'column theta_mm is unknown; next: use q1, x with _m or _mm, theta with _rad or _deg',
        ),
        (PLAIN.replace('q1', 'q1_deg'), 'column q1_deg is unknown'),
        (PLAIN.replace('x_mm', 'x_rad'), 'column x_rad is unknown'),
        (PLAIN.replace('q1', 'note_q1'), 'column q1 is missing or duplicate'),
    ],
)
def test_unreadable_table_is_rejected(tmp_path, text, message):
    path = tmp_path / 'table.csv'
    path.write_text(text, 'utf-8')
    with pytest.raises(CalibrationError, match=message):
        read_table(path, COLUMNS)


def test_empty_optional_cells_are_nan(tmp_path):
    path = tmp_path / 'table.csv'
    path.write_text('q1_mm,y,goal_x\n100,,5\n200,0.3,\n')
    table = read_table(path, ['q1'], ['x', 'y'])
    expected = np.array([[0.1, np.nan, np.nan], [0.2, np.nan, 0.3]])
    assert table == pytest.approx(expected, nan_ok=True)
