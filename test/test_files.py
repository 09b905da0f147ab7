"""Written files are complete, or the previous file stays."""

import errno
from pathlib import Path

import pytest

from facade_manipulator.package_files import atomic_write


def test_interrupted_write_keeps_the_previous_file(tmp_path):
    path = tmp_path / 'report.json'
    with atomic_write(path) as draft:
        draft.write_text('before')
    with pytest.raises(KeyboardInterrupt), atomic_write(path) as draft:
        draft.write_text('half')
        raise KeyboardInterrupt
    assert path.read_text() == 'before'
    assert list(tmp_path.iterdir()) == [path]


def test_file_that_is_a_mount_point_is_overwritten(tmp_path, monkeypatch):
    def refuse(draft, target):
        raise OSError(errno.EBUSY, 'Device or resource busy', str(draft), str(target))

    monkeypatch.setattr(Path, 'replace', refuse)  # as rename does for a bind mount
    path = tmp_path / 'machine.yaml'
    path.write_text('before')
    with atomic_write(path) as draft:
        draft.write_text('after')
    assert path.read_text() == 'after'
    assert (tmp_path / 'machine.yaml.bak').read_text() == 'before'
    assert len(list(tmp_path.iterdir())) == 2


def test_failed_write_names_the_file_of_the_user(tmp_path):
    path = tmp_path / 'nowhere/machine.yaml'
    with pytest.raises(FileNotFoundError) as failed, atomic_write(path) as draft:
        draft.write_text('after')
    assert failed.value.filename == str(path)
