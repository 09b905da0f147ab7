"""Options and exit statuses of the command-line tools."""

from __future__ import annotations

from argparse import ArgumentTypeError
from collections.abc import Callable
import math
import sys

from facade_manipulator.errors import ManipulatorError


def exit_status(
    name: str,
    action: Callable[[], None],
    failed: int = 1,
    interrupted: str = 'interrupted',
) -> int:
    """Run a command and return its exit status; an error is one line on standard error."""
    try:
        action()
        return 0
    except KeyboardInterrupt:
        message, failed = interrupted, 130  # as a shell reports Ctrl-C
    except ModuleNotFoundError as error:
        message = f'{error}; next: pip install the extras of setup.py'
    except (ManipulatorError, OSError) as error:
        message = str(error)
    print(f'{name}: {message}', file=sys.stderr)
    return failed


def above_zero(text: str) -> float:
    """Return the finite number above 0 in the text of an option; argparse calls this function."""
    value = float(text)
    if not 0.0 < value < math.inf:
        raise ArgumentTypeError(f'{text} is not a finite number above 0')
    return value
