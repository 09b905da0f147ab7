"""
Entry points of the executables.

An executable may need packages of an extra that is not installed. Each entry point therefore
imports its module when it is called, and reports a missing package in one sentence.
"""

from __future__ import annotations

from functools import partial
from importlib import import_module
from importlib.util import find_spec
import os
import signal
import sys
from types import FrameType

from facade_manipulator.command_line import missing_package

CANNOT_START = 2  # exit status
# with these values no window is opened; a value of another project may end the import
SETTINGS = {'MPLBACKEND': 'agg', 'MUJOCO_GL': 'disable'}


def run(name: str, module: str) -> int:
    """Run the function `main` of a module in this package; return its exit status."""
    os.environ.update(SETTINGS)
    # an import takes a second, and an exception in it may be caught or printed
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
    try:
        main = import_module(f'facade_manipulator.{module}').main
    except ModuleNotFoundError as error:
        print(f'{name}: {missing_package(error)}', file=sys.stderr)
        return CANNOT_START
    signal.signal(signal.SIGINT, before)
    status: int = main()
    return status


INTERRUPTED = 130  # exit status, as a shell reports Ctrl-C


def _end(_: int, __: FrameType | None) -> None:
    """End the process at once, because nothing has been started yet."""
    os._exit(INTERRUPTED)


OF_WHEELS = 'rmw_fastrtps_cpp'


def run_with_ros(name: str, module: str) -> int:
    """
    Run an executable that uses ROS; return its exit status.

    The wheels of ROS 2 end the process inside the import of rclpy if another middleware is
    selected.
    """
    middleware = os.environ.get('RMW_IMPLEMENTATION', OF_WHEELS)
    if find_spec('ros_wheels_bootstrapper') and middleware != OF_WHEELS:
        print(
            f'{name}: RMW_IMPLEMENTATION={middleware} rejected: the wheels of ROS 2 contain only '
            f'{OF_WHEELS}; next: unset RMW_IMPLEMENTATION',
            file=sys.stderr,
        )
        return CANNOT_START
    return run(name, module)


driver = partial(run_with_ros, 'driver', 'nodes.driver')
ik_service = partial(run_with_ros, 'ik_service', 'nodes.ik_service')
compensator = partial(run_with_ros, 'compensator', 'nodes.compensator')
manipulator = partial(run_with_ros, 'manipulator', 'nodes.manipulator')
disturbance_estimator = partial(
    run_with_ros, 'disturbance_estimator', 'nodes.disturbance_estimator'
)
gondola_simulator = partial(
    run_with_ros, 'gondola_simulator', 'simulation.gondola_simulator'
)
drive_simulator = partial(run, 'drive_simulator', 'simulation.drives.__main__')
calibrate = partial(run, 'calibrate', 'tools.calibration.__main__')
commission = partial(run, 'commission', 'tools.commissioning.__main__')
stopping = partial(run, 'stopping', 'tools.stopping')
demo = partial(run_with_ros, 'demo', 'simulation.demo.demo')
workspace_study = partial(run, 'workspace_study', 'study.__main__')
