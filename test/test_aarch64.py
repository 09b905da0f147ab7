"""The wheel of ruckig that is made for aarch64, run where this computer can."""

from __future__ import annotations

import json
import os
from pathlib import Path
import platform
import shutil
import subprocess
import sys
import zipfile

import pytest
import typing_extensions

TOP = Path(__file__).resolve().parents[1]
FOLDER = TOP / '.venv/aarch64'
LIBRARIES = '/usr/lib/aarch64-linux-gnu'
PYTHON = ('qemu-aarch64', '-L', FOLDER / 'root',
          '-E', f'LD_LIBRARY_PATH={LIBRARIES}/blas:{LIBRARIES}/lapack',
          FOLDER / 'root/usr/bin/python3.13')
PATH_OF_THE_HEAD = """
import json, platform
from facade_manipulator.kinematics import Pose
from facade_manipulator.motion import HeadMotion, ReferencePath, ReferenceSettings

path = ReferencePath(ReferenceSettings())
path.initialise(0.0, HeadMotion(Pose(-0.1, 0.15, 0.0)), Pose(0.2, 0.3, 0.1))
print(json.dumps([platform.machine(), path.arrival(), *(
    path.at(share * path.arrival()).position for share in (0.1, 0.3, 0.6, 0.9))]))
"""


def build(**environment):
    return subprocess.run(['.ci/aarch64'], cwd=TOP, env={**os.environ, **environment},
                          capture_output=True, text=True)


@pytest.fixture
def wheel():
    for program in ('aarch64-linux-gnu-g++', 'qemu-aarch64'):
        if shutil.which(program) is None:
            pytest.skip(f'{program} is not installed')
    done = build()
    if 'fetch: ' in done.stderr and 'CI' not in os.environ:
        pytest.skip(done.stderr)
    assert done.returncode == 0, done.stderr
    (found,) = FOLDER.glob('ruckig-*-cp312-abi3-linux_aarch64.whl')
    return found


def head_path(*python, folder):
    done = subprocess.run(
        [*python, '-c', PATH_OF_THE_HEAD], text=True, capture_output=True,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(map(str, (folder, TOP)))})
    assert done.returncode == 0, done.stderr
    machine, arrival, *positions = json.loads(done.stdout)
    return machine, [arrival, *(value for position in positions for value in position)]


@pytest.mark.long
def test_the_head_takes_the_same_path_on_aarch64(wheel, tmp_path):
    zipfile.ZipFile(wheel).extractall(tmp_path)
    shutil.copy(typing_extensions.__file__, tmp_path)
    machine, there = head_path(*PYTHON, folder=tmp_path)
    assert machine == 'aarch64' != platform.machine()
    _, here = head_path(sys.executable, folder=TOP)
    assert there == pytest.approx(here, abs=1e-12)


def test_without_a_cross_compiler_there_is_no_such_wheel(tmp_path):
    for program in ('bash', 'dirname'):
        (tmp_path / program).symlink_to(shutil.which(program))
    done = build(PATH=str(tmp_path))
    assert done.returncode == 1 and 'g++-aarch64-linux-gnu' in done.stderr
