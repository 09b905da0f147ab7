"""Where a recording comes from: the computer, and the files that the machine was started with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import pairwise
import os
from pathlib import Path
import platform
import sys
from typing import Any

from facade_manipulator.drives.cia402 import profile_files
from facade_manipulator.errors import ManipulatorError


def host() -> dict[str, str]:
    """Return what the computer is, for the engineer who does not stand before it."""
    return {'host': platform.node(), 'platform': platform.platform(),
            'python': platform.python_version(),
            'middleware': os.environ.get('RMW_IMPLEMENTATION', '')}


def carried_files(
    driver: Mapping[str, Any], arguments: Sequence[str] | None = None
) -> list[Path]:
    """
    Return the drive types of the driver's parameters, and a process's parameter files.

    Those that are not on this computer are left out; the arguments are this process's own.
    """
    given = pairwise(sys.argv if arguments is None else arguments)
    profiles = {value for name, value in driver.items() if name.endswith('.profile')}
    files = [path for name in sorted(profiles) for path in _drive_files(name)]
    files += [Path(path) for option, path in given if option == '--params-file']
    return [path for path in files if path.is_file()]


def _drive_files(profile: str) -> list[Path]:
    with suppress(ManipulatorError):
        return [*profile_files(profile)]
    return []
