"""Set-up of .venv on computers with other settings of pip."""

from importlib.util import find_spec
import os
from pathlib import Path
import subprocess
import sys

CI = Path(__file__).resolve().parents[1] / '.ci'
FETCHING = {
    'PIP_INDEX_URL': 'https://example.org',
    'PIP_NO_INDEX': '1',
    'PIP_CERT': 'my.pem',
    'PIP_NO_CACHE_DIR': '1',
    'PIP_DEFAULT_TIMEOUT': '60',
    'PIP_CONFIG_FILE': 'my.conf',
    'UV_INDEX_URL': 'https://example.org',
}
INSTALLING = {
    'PIP_USER': '1',
    'PIP_TARGET': 'there',
    'PIP_PREFIX': 'there',
    'PIP_DRY_RUN': '1',
    'PIP_REQUIRE_HASHES': '1',
    'PIP_NO_BINARY': ':all:',
    'PIP_CONSTRAINT': 'mine.txt',
    'UV_CONSTRAINT': 'mine.txt',
    'UV_SYSTEM_PYTHON': '1',
    'UV_NO_BINARY': '1',
}
OF_OTHER_PROJECTS = {
    'PYTHONWARNINGS': 'error',
    'MUJOCO_GL': 'osmesa',
    'PYOPENGL_PLATFORM': 'osmesa',
    'MPLBACKEND': 'of_mine',
}
PIP_FILE = """
[global]
index-url = https://example.org/simple
extra-index-url =
    https://example.org/a
    https://example.org/b
timeout = 60
constraint = mine.txt
[install]
index-url = https://example.org/install
target = there
prefix = there
root = there
dry-run = true
no-binary = :all:
require-hashes = true
"""


def output_of(code, environment, folder=CI):
    """Return the lines that a script of bash prints with an environment."""
    done = subprocess.run(
        ['bash', '-euc', code],
        cwd=folder,
        text=True,
        capture_output=True,
        check=True,
        env={'PATH': os.environ['PATH'], **environment},
    )
    return done.stdout.splitlines()


def test_pip_settings_keep_the_source_of_packages():
    lines = output_of('. ./pip-settings; env', FETCHING | INSTALLING)
    settings = [line for line in lines if line.startswith(('PIP_', 'UV_'))]
    left = dict(line.split('=', 1) for line in settings)
    assert left == FETCHING | {'PIP_USER': '0'}


# a .venv made by uv has no pip, nor has the interpreter of a minimal Debian
PYTHON_WITH_PIP = sys.executable if find_spec('pip') else sys._base_executable


def test_pip_files_keep_only_the_source_of_packages(tmp_path):
    (tmp_path / 'pip.conf').write_text(PIP_FILE)
    environment = {
        'PIP_CONFIG_FILE': str(tmp_path / 'pip.conf'),
        'PIP_TIMEOUT': '30',
        'PYTHON': PYTHON_WITH_PIP,
    }
    code = '. ./pip-settings; keep_sources_of_pip_files "$PYTHON"; "$PYTHON" -m pip config list'
    left = dict(line.split('=', 1) for line in output_of(code, environment))
    for name, value in {
        'index-url': 'https://example.org/install',
        'extra-index-url': 'https://example.org/a https://example.org/b',
        'timeout': '30',
        'config-file': '/dev/null',
        'user': '0',
    }.items():
        assert left.pop(f':env:.{name}') == repr(value)
    fetching = ('cert', 'find-links', 'trusted-host', 'proxy')  # of this computer
    assert not [name for name in left if not name.endswith(fetching)]


def test_environment_has_no_variables_of_another_ros():
    stamp = (CI.parent / '.venv/stamp').read_text()
    others = {
        'RMW_IMPLEMENTATION': 'rmw_cyclonedds_cpp',
        'PYTHONPATH': '/opt/ros/rolling',
        'LD_LIBRARY_PATH': '/opt/ros/rolling/lib',
        **OF_OTHER_PROJECTS,
    }
    lines = output_of('. .venv/environment; env', others, CI.parent)
    left = {line.partition('=')[0] for line in lines} & set(others)
    # packages of a sourced ROS need its variables
    expected = (
        set() if stamp.startswith('wheels') else set(others) - set(OF_OTHER_PROJECTS)
    )
    assert left == expected
