"""Tables as spreadsheets write them."""

from __future__ import annotations

from io import StringIO
import sys

import numpy as np
import pytest

from facade_manipulator.errors import CalibrationError
from facade_manipulator.tools.calibration.tables import read_table, TYPED

COLUMNS = ('q1', 'x', 'theta')
PLAIN = 'q1,x_mm,theta,note_1\n0.1,2.5,0.3,good\n-0.2,1250,1e-2,\n'
EXPECTED = [[0.1, 0.0025, 0.3], [-0.2, 1.25, 0.01]]
GERMAN = PLAIN.replace(',', ';').replace('.', ',')


@pytest.mark.parametrize('encoding', ['utf-8', 'utf-8-sig', 'cp1252'])
@pytest.mark.parametrize('text', [
    PLAIN, GERMAN, GERMAN.replace('\n', '\r\n'), f'sep=;\n{GERMAN}',
    GERMAN.replace('good', 'für später'),
    GERMAN.replace('\n', '\n;;;\n\n'), GERMAN.replace('\n', ';;\n'),
    PLAIN.replace('0.1,2.5', '"0.1","2.5"')])
def test_table_of_a_spreadsheet_is_read(tmp_path, text, encoding):
    path = tmp_path / 'table.csv'
    path.write_bytes(text.encode(encoding))
    assert np.allclose(read_table(path, COLUMNS), EXPECTED, atol=0.0)


def test_typed_table_may_begin_with_a_byte_order_mark(monkeypatch):
    monkeypatch.setattr(sys, 'stdin', StringIO(f'\ufeff{GERMAN}'))
    assert np.allclose(read_table(TYPED, COLUMNS), EXPECTED, atol=0.0)


@pytest.mark.parametrize(('text', 'message'), [
    ('q1,x,theta\n0,1,0,2,0,3\n', r"row 1 \(line 2\): cell 4 = '2' is beyond the last of 3"),
    ('q1,x,theta\n"0,1","0,2","0,3"\n', r"row 1 \(line 2\): q1 = '0,1' is not a number"),
    (GERMAN.replace('1250', '1.250,5'), r"row 2 \(line 3\): x_mm = '1.250.5' is not a number"),
    (GERMAN.replace('0,3', '#DIV/0!'), r"row 1 \(line 2\): theta = '#DIV/0!' is not a number"),
    (f'{GERMAN};;;\n0,1;;0,3;\n', r'row 3 \(line 5\): x_mm is missing'),
    (PLAIN.replace('note_1', 'x_mm'), 'has the column x_mm twice'),
])
def test_cell_that_is_not_a_number_is_named(tmp_path, text, message):
    path = tmp_path / 'table.csv'
    path.write_text(text, 'utf-8')
    with pytest.raises(CalibrationError, match=message):
        read_table(path, COLUMNS)
