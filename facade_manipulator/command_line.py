"""Options and exit statuses common to the command-line tools."""

from __future__ import annotations

from argparse import ArgumentTypeError
from collections.abc import Callable
from importlib.util import find_spec
import math
import os
import sys

from facade_manipulator.errors import file_sentence, ManipulatorError

BROKEN_PIPE = 141  # exit status, as a shell reports SIGPIPE


def exit_status(
    name: str,
    action: Callable[[], None],
    failed: int = 1,
    interrupted: str = 'interrupted',
) -> int:
    """Run a command and return its exit status; print an error as one line on standard error."""
    try:
        action()
        sys.stdout.flush()
        return 0
    except BrokenPipeError:  # the reader, such as `head`, needs no more lines
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except KeyboardInterrupt:
        message = interrupted
        failed = 130  # as a shell reports Ctrl-C
    except ModuleNotFoundError as error:
        message = missing_package(error)
    except OSError as error:
        message = file_sentence(error)
    except ManipulatorError as error:
        message = str(error)
    print(f'{name}: {message}', file=sys.stderr)
    return failed


# extra of setup.py by the packages that it installs
EXTRA_OF = {
    'matplotlib': 'study',
    'PIL': 'study',
    'rich': 'study',
    'scipy': 'calibration',
    'rosbags': 'calibration',
    'mujoco': 'simulation',
    'distributed': 'cluster',
}


def missing_package(error: ModuleNotFoundError) -> str:
    """Return the message for a Python package that is not installed."""
    package = str(error.name).partition('.')[0]
    if extra := EXTRA_OF.get(package):
        step = f'install the extra {extra} of facade_manipulator (docs/installation.md)'
    elif package == 'rclpy' or package.endswith(('_msgs', '_interfaces')):
        step = 'source ROS 2 Jazzy, or install the extra ros of facade_manipulator'
    else:
        step = 'install facade_manipulator again, with its dependencies'
    return f'the Python package {package} is not installed; next: {step}'


def require_packages(*names: str) -> None:
    """Raise a ModuleNotFoundError for the first Python package that is not installed."""
    for name in names:
        if find_spec(name) is None:
            raise ModuleNotFoundError(name=name)


def above_zero(text: str) -> float:
    """Convert the text of an option to a finite number above 0; called by argparse."""
    value = float(text)
    if not 0.0 < value < math.inf:
        raise ArgumentTypeError(f'{text} is not a finite number above 0')
    return value
