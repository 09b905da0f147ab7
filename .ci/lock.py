"""
Write .ci/constraints.txt again, with the hashes of the wheels for Linux on x86-64.

Needs uv. A pinned version stays unless its name is an argument.
"""

from __future__ import annotations

from pathlib import Path
import re
import subprocess
import sys
import tempfile
import tomllib

CONSTRAINTS = Path('.ci/constraints.txt')
HEAD = """\
# What .ci/setup-venv installs where ROS 2 comes from wheels: python .ci/lock.py makes it again.
"""
WHEEL = re.compile(
    r'.*-(py3|py2\.py3|cp3\d+)-(none|abi3|cp31[1-3])-(any|manylinux.*_x86_64.*)\.whl'
)
AARCH64 = re.compile(r'.*(any|linux.*aarch64)\.whl')


def main(renewed: list[str]) -> None:
    """Resolve for all versions of Python at once, and write."""
    pins = [
        line.partition(' --hash')[0] for line in CONSTRAINTS.read_text().splitlines()
    ]
    with tempfile.TemporaryDirectory() as name:
        kept, lock = Path(name, 'kept.txt'), Path(name, 'pylock.toml')
        kept.write_text(
            '\n'.join(pin for pin in pins if pin.partition('==')[0] not in renewed)
        )
        subprocess.run(
            [
                'uv',
                'pip',
                'compile',
                '-q',
                'setup.py',
                '--universal',
                '--python-version',
                '3.11',
                '--all-extras',
                '--no-emit-package',
                'colorama',
                '--constraint',
                kept,
                '--output-file',
                lock,
            ],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        packages = tomllib.loads(lock.read_text())['packages']
    CONSTRAINTS.write_text(HEAD + ''.join(map(line, packages)))


def line(package: dict) -> str:
    """Return name, version, marker and hashes of a package."""
    marker = f' ; {package["marker"]}' if 'marker' in package else ''
    wheels = {one['url'].rpartition('/')[2]: one for one in package.get('wheels', ())}
    files = [one for name, one in wheels.items() if WHEEL.fullmatch(name)]
    if 'sdist' in package and not any(map(AARCH64.fullmatch, wheels)):
        files.append(package['sdist'])  # pip builds empy, and ruckig on aarch64
    return (
        ' '.join(
            [
                f'{package["name"]}=={package["version"]}{marker}',
                *(f'--hash=sha256:{one["hashes"]["sha256"]}' for one in files),
            ]
        )
        + '\n'
    )


if __name__ == '__main__':
    main(sys.argv[1:])
