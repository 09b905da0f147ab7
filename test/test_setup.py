"""Set-up of .venv on computers with other settings, file systems and ROS installations."""

from __future__ import annotations

import os
from pathlib import Path
import shutil
import subprocess

import pytest

CI = Path(__file__).resolve().parents[1] / '.ci'
FETCHING = {
    'PIP_INDEX_URL': 'https://example.org', 'PIP_NO_INDEX': '1', 'PIP_CERT': 'my.pem',
    'PIP_NO_CACHE_DIR': '1', 'PIP_DEFAULT_TIMEOUT': '60', 'PIP_CONFIG_FILE': 'my.conf'}
INSTALLING = {
    'PIP_USER': '1', 'PIP_TARGET': 'there', 'PIP_PREFIX': 'there', 'PIP_DRY_RUN': '1',
    'PIP_REQUIRE_HASHES': '1', 'PIP_NO_BINARY': ':all:', 'PIP_CONSTRAINT': 'mine.txt'}


@pytest.mark.skipif(not CI.is_dir(), reason='not a checkout')
def test_pip_settings_keep_the_source_of_packages():
    done = subprocess.run(
        ['bash', '-euc', '. ./pip-settings; env'], cwd=CI, text=True, capture_output=True,
        check=True, env={'PATH': os.environ['PATH'], **FETCHING, **INSTALLING})
    left = dict(line.split('=', 1) for line in done.stdout.splitlines() if line.startswith('PIP_'))
    assert left == FETCHING | {'PIP_USER': '0'}


@pytest.mark.skipif(not CI.is_dir(), reason='not a checkout')
def test_setup_continues_on_a_file_system_without_locks(tmp_path):
    shutil.copytree(CI, tmp_path / '.ci')
    for name, text in (('flock', 'exit 1'), (
            'no_python', '[ "$1" = --version ] && echo a Python of another kind')):
        (tmp_path / name).write_text(f'#!/bin/sh\n{text}\n')
        (tmp_path / name).chmod(0o755)
    done = subprocess.run(
        [tmp_path / '.ci/setup-venv'], text=True, capture_output=True,
        env={'PATH': f'{tmp_path}:{os.environ["PATH"]}', 'PYTHON': str(tmp_path / 'no_python')})
    assert 'no lock is possible on this file system: run one make at a time.' in done.stdout
    assert 'is needed' in done.stderr and 'a Python of another kind' in done.stderr
