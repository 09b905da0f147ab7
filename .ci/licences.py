"""Add licences to a list of components (CycloneDX): what wheels say in METADATA or package.xml."""

from __future__ import annotations

from collections.abc import Iterator
import json
from pathlib import Path
import re
import sys
from xml.etree import ElementTree
from zipfile import ZipFile


def main(components: Path, wheels: Path) -> str:
    """Complete the list; return how many say nothing."""
    listed = json.loads(components.read_text())
    found = dict(one for wheel in sorted(wheels.glob('*.whl')) for one in licences(wheel))
    lacking = [one for one in listed['components'] if not one.get('licenses')]
    for one in lacking:
        if name := found.get(plain(one['name'])):
            one['licenses'] = [{'license': {'name': name, 'acknowledgement': 'declared'}}]
    components.write_text(json.dumps(listed, indent=2, sort_keys=True) + '\n')
    silent = sorted(one['name'] for one in lacking if not one.get('licenses'))
    return f'licences: {len(silent)} of {len(listed["components"])} components name none' + (
        f': {", ".join(silent)}' if silent else '')


def licences(wheel: Path) -> Iterator[tuple[str, str]]:
    """Yield names of what a wheel holds, and their licences."""
    with ZipFile(wheel) as archive:
        for path in archive.namelist():
            if path.count('/') == 1 and path.endswith('.dist-info/METADATA'):
                text = archive.read(path).decode()
                if said := re.search(r'^License(?:-Expression)?: (.+)', text, re.MULTILINE):
                    yield plain(path.split('-')[0]), said[1]
            elif path.endswith('/package.xml'):
                manifest = ElementTree.fromstring(archive.read(path))
                said = ', '.join(one.text.strip() for one in manifest.findall('license'))
                yield plain(manifest.findtext('name')), said


def plain(name: str) -> str:
    """Return a name as wheels and packages of ROS have it in common."""
    return name.lower().replace('-', '_').removeprefix('ros_')


if __name__ == '__main__':
    print(main(Path(sys.argv[1]), Path(sys.argv[2])))
