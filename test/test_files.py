"""Written files are complete, or the previous file stays."""

import pytest

from facade_manipulator.resources import atomic_write


def test_interrupted_write_keeps_the_previous_file(tmp_path):
    path = tmp_path / 'report.json'
    with atomic_write(path) as draft:
        draft.write_text('before')
    with pytest.raises(KeyboardInterrupt), atomic_write(path) as draft:
        draft.write_text('half')
        raise KeyboardInterrupt
    assert path.read_text() == 'before' and list(tmp_path.iterdir()) == [path]
