"""A written file is complete, or the previous file stays."""

import pytest

from facade_manipulator.errors import ParameterError
from facade_manipulator.files import atomic_write


def test_interrupted_write_keeps_previous_file(tmp_path):
    path = tmp_path / 'report.json'
    with atomic_write(path) as draft:
        draft.write_text('before')
    with pytest.raises(KeyboardInterrupt), atomic_write(path) as draft:
        draft.write_text('half')
        raise KeyboardInterrupt
    assert path.read_text() == 'before' and list(tmp_path.iterdir()) == [path]


def test_unwritable_path_is_rejected_by_name(tmp_path):
    (tmp_path / 'file').write_text('mine')
    path = tmp_path / 'file' / 'report.json'
    with (pytest.raises(ParameterError, match=f'{path} cannot be written: Not a directory'),
          atomic_write(path) as draft):
        draft.write_text('new')
    assert (tmp_path / 'file').read_text() == 'mine'
