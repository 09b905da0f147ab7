"""A file is what it was before, or what it was meant to become."""

import pytest

from facade_manipulator.files import atomic_write


def test_a_file_that_fails_on_the_way_leaves_the_one_before(tmp_path):
    path = tmp_path / 'report.json'
    with atomic_write(path) as draft:
        draft.write_text('before')
    with pytest.raises(KeyboardInterrupt), atomic_write(path) as draft:
        draft.write_text('half')
        raise KeyboardInterrupt
    assert path.read_text() == 'before' and list(tmp_path.iterdir()) == [path]


def test_a_block_that_writes_nothing_is_an_error_and_no_empty_file(tmp_path):
    with pytest.raises(FileNotFoundError), atomic_write(tmp_path / 'report.json'):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_is_none_is_told_as_it_is(tmp_path):
    (tmp_path / 'file').write_text('mine')
    with (pytest.raises(NotADirectoryError),
          atomic_write(tmp_path / 'file' / 'report.json') as draft):
        draft.write_text('new')
    assert (tmp_path / 'file').read_text() == 'mine'
