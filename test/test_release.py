"""The script of a release, in a clone."""

from __future__ import annotations

from pathlib import Path
import re
import shutil
import subprocess
import tempfile

import pytest

TOP = Path(__file__).resolve().parents[1]
CHANGES = 'CHANGELOG.rst'


@pytest.fixture
def clone(tmp_path):
    """Make a repository of what the script reads and writes."""
    for name in ('package.xml', CHANGES, '.ci/release'):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes((TOP / name).read_bytes())
    (tmp_path / '.ci/release').chmod(0o755)
    text = (TOP / CHANGES).read_text()
    if 'Forthcoming' not in text:
        (tmp_path / CHANGES).write_text(text.replace(
            '\n\n', '\n\nForthcoming\n-----------\n* new\n\n', 1))
    git(tmp_path, 'init', '--quiet')
    git(tmp_path, 'config', 'user.name', 'a')
    git(tmp_path, 'config', 'user.email', 'a@b')
    git(tmp_path, 'add', '--all')
    git(tmp_path, 'commit', '--quiet', '--message', 'all')
    return tmp_path


def git(folder, *arguments):
    return subprocess.run(['git', '-C', folder, *arguments], check=True, capture_output=True,
                          text=True).stdout


def release(folder, *arguments):
    return subprocess.run(['.ci/release', *arguments], cwd=folder, capture_output=True, text=True)


def test_a_release_is_one_commit_with_version_and_date(clone):
    done = release(clone, '7.8.9')
    assert done.returncode == 0 and '.ci/release sign' in done.stdout
    assert '<version>7.8.9</version>' in (clone / 'package.xml').read_text()
    title, line = re.search(
        r'^(7\.8\.9 \(\d{4}-\d\d-\d\d\))\n(-+)\n\* ', (clone / CHANGES).read_text(),
        re.MULTILINE).groups()
    assert len(title) == len(line)
    assert git(clone, 'log', '--format=%s', '-1') == 'release: 7.8.9\n'
    assert git(clone, 'show', '--stat', '--format=').count('|') == 2
    again = release(clone, '7.8.10')
    assert again.returncode == 1 and 'nothing is “Forthcoming”' in again.stderr


def test_what_is_no_release_changes_nothing(clone):
    before = git(clone, 'rev-parse', 'HEAD')
    git(clone, 'tag', '7.0.0')
    for version, message in (('', 'usage'), ('1.2', 'usage'), ('0.0.1', 'older'),
                             ('7.0.0', 'is there')):
        done = release(clone, version)
        assert done.returncode == 1 and message in done.stderr
    (clone / 'package.xml').write_text('mine')
    assert 'commit what is changed first' in release(clone, '7.8.9').stderr
    assert git(clone, 'rev-parse', 'HEAD') == before


@pytest.fixture
def key(clone, monkeypatch):
    """Make a key for this test, in a folder whose name is short enough for gpg's sockets."""
    if shutil.which('gpg') is None:
        pytest.skip('gpg is not installed')
    with tempfile.TemporaryDirectory(dir='/tmp') as home:
        monkeypatch.setenv('GNUPGHOME', home)
        subprocess.run(['gpg', '--batch', '--passphrase', '', '--quick-generate-key', 'a@b',
                        'ed25519', 'sign'], check=True, capture_output=True)
        git(clone, 'config', 'user.signingkey', 'a@b')
        yield
        subprocess.run(['gpgconf', '--kill', 'gpg-agent'], check=True)


def package(clone):
    """Make a folder as `make package` does, of the newest commit."""
    commit = git(clone, 'rev-parse', '--short', 'HEAD').strip()
    (clone / '.git/info/exclude').write_text('dist\n')
    wheels = clone / 'dist/wheels'
    wheels.mkdir(parents=True)
    (wheels / f'facade_manipulator-7.8.9+g{commit}-py3-none-any.whl').write_text('content')
    subprocess.run('sha256sum wheels/* >SHA256SUMS', cwd=wheels.parent, shell=True, check=True)
    return wheels.parent


def test_tag_and_checksums_are_signed_and_what_is_altered_is_noticed(clone, key):
    assert release(clone, '7.8.9').returncode == 0
    assert 'dist/ is not of this commit' in release(clone, 'sign').stderr
    dist = package(clone)
    done = release(clone, 'sign')
    assert done.returncode == 0, done.stderr
    git(clone, 'verify-tag', '7.8.9')
    verify = ['gpg', '--verify', dist / 'SHA256SUMS.asc', dist / 'SHA256SUMS']
    assert subprocess.run(verify, capture_output=True).returncode == 0
    with (dist / 'SHA256SUMS').open('a') as file:
        file.write('more')
    assert subprocess.run(verify, capture_output=True).returncode == 1


def test_what_was_not_released_or_not_packaged_of_it_is_not_signed(clone, key):
    assert 'is no release' in release(clone, 'sign').stderr
    release(clone, '7.8.9')
    next((package(clone) / 'wheels').iterdir()).write_text('altered')
    assert 'not as packaged' in release(clone, 'sign').stderr
    assert git(clone, 'tag') == ''
