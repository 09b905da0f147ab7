"""Set-up of .venv on computers with other settings of pip."""

import os
from pathlib import Path
import subprocess

CI = Path(__file__).resolve().parents[1] / '.ci'
FETCHING = {
    'PIP_INDEX_URL': 'https://example.org',
    'PIP_NO_INDEX': '1',
    'PIP_CERT': 'my.pem',
    'PIP_NO_CACHE_DIR': '1',
    'PIP_DEFAULT_TIMEOUT': '60',
    'PIP_CONFIG_FILE': 'my.conf',
}
INSTALLING = {
    'PIP_USER': '1',
    'PIP_TARGET': 'there',
    'PIP_PREFIX': 'there',
    'PIP_DRY_RUN': '1',
    'PIP_REQUIRE_HASHES': '1',
    'PIP_NO_BINARY': ':all:',
    'PIP_CONSTRAINT': 'mine.txt',
}


def test_pip_settings_keep_the_source_of_packages():
    done = subprocess.run(
        ['bash', '-euc', '. ./pip-settings; env'],
        cwd=CI,
        text=True,
        capture_output=True,
        check=True,
        env={'PATH': os.environ['PATH'], **FETCHING, **INSTALLING},
    )
    left = dict(
        line.split('=', 1)
        for line in done.stdout.splitlines()
        if line.startswith('PIP_')
    )
    assert left == FETCHING | {'PIP_USER': '0'}
