"""Definitions of message types as text, for files that describe themselves."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
import re

from ament_index_python.packages import get_package_share_directory

_TYPE = re.compile(r'(\w+)/(\w+)')
_RULE = '=' * 80


def type_name(kind: type) -> str:
    """Return the full name of a message class, such as ``geometry_msgs/msg/PoseStamped``."""
    return f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'


def message_definition(kind: type) -> str:
    """
    Return the definition of a message class followed by those of all that it contains.

    Raises
    ------
    OSError, LookupError
        If the package's ``.msg`` files are not installed.

    References
    ----------
    MCAP registry, schema encoding ``ros2msg``.

    """
    parts = [_source(kind)]
    parts += [f'{_RULE}\nMSG: {part.__module__.split(".")[0]}/{part.__name__}\n{_source(part)}'
              for part in dict.fromkeys(_contained(kind))]
    return ''.join(parts)


def _source(kind: type) -> str:
    package, folder, name = type_name(kind).split('/')
    path = Path(get_package_share_directory(package)) / folder / f'{name}.msg'
    return path.read_text(encoding='utf-8').rstrip() + '\n'


def _contained(kind: type) -> Iterator[type]:
    for field in kind.get_fields_and_field_types().values():
        for package, name in _TYPE.findall(field):
            part = getattr(import_module(f'{package}.msg'), name)
            yield part
            yield from _contained(part)
