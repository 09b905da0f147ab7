"""Written files are complete, or the previous file stays."""

import errno
import os
from pathlib import Path
import stat
import threading

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


def test_link_to_another_folder_keeps_pointing_to_the_new_file(tmp_path):
    other = tmp_path / 'other'
    other.mkdir()
    link = tmp_path / 'machine.yaml'
    link.symlink_to(other / 'target.yaml')
    for content in ('before', 'after'):
        with atomic_write(link) as draft:
            # a draft on another file system could not replace the target
            assert draft.parent == other
            draft.write_text(content)
        assert link.is_symlink()
        assert [path.name for path in other.iterdir()] == ['target.yaml']
        assert link.read_text() == content


@pytest.fixture
def private_umask():
    """Give new files permissions only for their owner, as `umask 077` does."""
    before = os.umask(0o077)
    yield
    os.umask(before)


@pytest.mark.usefixtures('private_umask')
@pytest.mark.parametrize('mode', [0o664, 0o640, 0o604])
def test_replaced_file_keeps_its_mode(tmp_path, mode):
    path = tmp_path / 'machine.yaml'
    path.write_text('before')
    path.chmod(mode)
    with atomic_write(path) as draft:
        draft.write_text('after')
    assert stat.S_IMODE(path.stat().st_mode) == mode


@pytest.mark.usefixtures('private_umask')
@pytest.mark.skipif(os.geteuid() != 0, reason='only root can give files away')
def test_file_replaced_by_root_keeps_its_owner(tmp_path):
    path = tmp_path / 'machine.yaml'
    path.write_text('before')
    path.chmod(0o664)
    os.chown(path, 1234, 2345)
    with atomic_write(path) as draft:
        draft.write_text('after')
    found = path.stat()
    assert (found.st_uid, found.st_gid) == (1234, 2345)
    assert stat.S_IMODE(found.st_mode) == 0o664


def test_replaced_file_of_another_owner_keeps_its_mode(tmp_path, monkeypatch):
    def refuse(file, user, group):
        raise PermissionError(errno.EPERM, 'Operation not permitted')

    monkeypatch.setattr(os, 'fchown', refuse)  # as for a user without privileges
    path = tmp_path / 'machine.yaml'
    path.write_text('before')
    path.chmod(0o664)
    with atomic_write(path) as draft:
        draft.write_text('after')
    assert path.read_text() == 'after'
    assert stat.S_IMODE(path.stat().st_mode) == 0o664


def test_fifo_receives_the_content_and_remains_a_fifo(tmp_path):
    path = tmp_path / 'fifo'
    os.mkfifo(path)
    received = []
    reader = threading.Thread(
        target=lambda: received.append(path.read_text()), daemon=True
    )
    reader.start()
    with atomic_write(path) as draft:
        draft.write_text('content')
    reader.join(5.0)
    assert received == ['content']
    assert path.is_fifo()
    assert list(tmp_path.iterdir()) == [path]


def test_device_is_written_and_not_replaced(tmp_path):
    path = tmp_path / 'link'
    path.symlink_to(os.devnull)
    with atomic_write(path) as draft:
        draft.write_text('content')
    assert Path(os.devnull).is_char_device()
    assert path.is_symlink()


def test_pipe_of_the_process_is_written():
    reading, writing = os.pipe()
    with atomic_write(Path(f'/dev/fd/{writing}')) as draft:
        draft.write_text('content')
    assert os.read(reading, 100) == b'content'
    os.close(reading)
    os.close(writing)


@pytest.mark.parametrize('name', ['.', '..', '', '/'])
def test_folder_instead_of_a_file_is_named(name):
    with pytest.raises(IsADirectoryError) as failed, atomic_write(Path(name)) as draft:
        draft.write_text('after')
    assert failed.value.filename == str(Path(name))
