"""
Entry points of the executables.

An executable may need packages of an extra that is not installed. Each entry point therefore
imports its module when it is called, and reports a missing package in one sentence.
"""

from __future__ import annotations

from functools import partial
from importlib import import_module
import sys

from facade_manipulator.commands import missing_package

MISSING_PACKAGE = 2  # exit status


def run(name: str, module: str) -> int:
    """Run the function `main` of a module of this package; return its exit status."""
    try:
        main = import_module(f'facade_manipulator.{module}').main
    except ModuleNotFoundError as error:
        print(f'{name}: {missing_package(error)}', file=sys.stderr)
        return MISSING_PACKAGE
    status: int = main()
    return status


driver = partial(run, 'driver', 'nodes.driver')
ik_service = partial(run, 'ik_service', 'nodes.ik_service')
compensator = partial(run, 'compensator', 'nodes.compensator')
manipulator = partial(run, 'manipulator', 'nodes.manipulator')
disturbance_estimator = partial(
    run, 'disturbance_estimator', 'nodes.disturbance_estimator'
)
gondola_simulator = partial(run, 'gondola_simulator', 'simulation.gondola_simulator')
drive_simulator = partial(run, 'drive_simulator', 'simulation.drives.__main__')
calibrate = partial(run, 'calibrate', 'tools.calibration.__main__')
commission = partial(run, 'commission', 'tools.commissioning.__main__')
stopping = partial(run, 'stopping', 'tools.stopping')
demo = partial(run, 'demo', 'simulation.demo.demo')
workspace_study = partial(run, 'workspace_study', 'study.__main__')
