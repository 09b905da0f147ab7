"""What a disk has at once after something was written: a computer may lose its power then."""

from __future__ import annotations

from contextlib import contextmanager
import os
from pathlib import Path
import shutil
import subprocess

import pytest
from test_blackbox import ABOUT, fill, shelf, stream

from facade_manipulator.maintenance import CounterFile


@contextmanager
def mounted(image: Path, folder: Path):
    folder.mkdir()
    done = subprocess.run(['mount', '-o', 'loop', image, folder], capture_output=True, check=False)
    if done.returncode:
        pytest.skip(f'no file system can be mounted here: {done.stderr.decode().strip()}')
    try:
        yield folder
    finally:
        subprocess.run(['umount', folder], check=True)


@pytest.fixture
def cut(tmp_path):
    """Give a function that writes on an ext4 and returns what is there after a power cut."""
    if os.geteuid() or not shutil.which('mkfs.ext4'):
        pytest.skip('needs root and mkfs.ext4')
    image, copy = tmp_path / 'disk', tmp_path / 'copy'
    with image.open('wb') as file:
        file.truncate(200_000_000)
    subprocess.run(['mkfs.ext4', '-q', image], check=True)

    def run(write) -> dict[str, bytes]:
        with mounted(image, tmp_path / 'before') as folder:
            write(folder)
            shutil.copyfile(image, copy)
        with mounted(copy, tmp_path / 'after') as folder:
            return {path.name: path.read_bytes() for path in folder.rglob('*') if path.is_file()}

    return run


def test_a_file_outlasts_the_power_that_goes_as_soon_as_it_is_written(cut, tmp_path):
    kept = cut(lambda folder: shelf(folder)[1](0.0, fill(1000)))
    path = tmp_path / 'file.mcap'
    path.write_bytes(kept['blackbox_000001_manipulator_19700101T000000Z.mcap'])
    assert path.stat().st_size > 1000


def test_segments_and_counters_outlast_it_and_what_is_not_synced_does_not(cut):
    def write(folder: Path) -> None:
        counting = CounterFile(str(folder), 'a')
        counting.counters.hours = 108.0
        counting.close()
        streamed = stream(folder)
        streamed.add(1.0, 'a', bytes(100))
        streamed.flush(ABOUT)
        (folder / 'not_synced').write_text('a')
        os.close(streamed._lock_file)  # as a process that ends

    kept = cut(write)
    assert b'108.0' in kept['counters_a.json'] and kept['00000000.mcap']
    assert not kept.get('not_synced')
