"""
Say what is wrong with this computer and with the nodes that run, and what to do about it.

It changes nothing and moves nothing. Exit status: 0 where nothing is wrong, 1 where something is,
2 where it could not look.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
import ctypes
from functools import partial
from importlib.metadata import PackageNotFoundError, requires, version
import os
from pathlib import Path
import shutil
import sys

from diagnostic_msgs.msg import DiagnosticStatus
from packaging.requirements import Requirement
import rclpy
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from facade_manipulator.blackbox import BlackBoxSettings, RESERVE
from facade_manipulator.drives.controller import (
    ControllerSettings,
    describe_scheduling,
    Finding,
    request_realtime,
)
from facade_manipulator.errors import exit_status
from facade_manipulator.maintenance import ServiceSettings
from facade_manipulator.messages import status_values
from facade_manipulator.parameter_file import read_settings
from facade_manipulator.resources import config_path, PACKAGE
from facade_manipulator.ros import ManipulatorClient, ros_errors, USAGE_ERROR

LISTENING = 4.0  # s: nodes are found within some 1 s, and publish /diagnostics once a second
TRIED_RMW = 'rmw_fastrtps_cpp'
TIMEX_SIZE, TIME_ERROR = 512, 5  # bytes and more than struct timex has; adjtimex(2)
BUS = 'driver: bus'
SOLE = tuple(f'/{topic}' for topic in (  # topics that one node alone may publish
    'driver/status', 'joint_states', 'joint_setpoints', 'corrected_pose', 'disturbance',
    'software_stop'))
ENCLAVES = ('driver', 'manipulator', 'recorder')
ENCLAVE_FILES = ('cert.pem', 'key.pem', 'governance.p7s', 'permissions.p7s',
                 'identity_ca.cert.pem', 'permissions_ca.cert.pem')


def main(arguments: Sequence[str] | None = None) -> int:
    """Print what was found; return the exit status."""
    words = remove_ros_args(args=sys.argv if arguments is None else ['doctor', *arguments])[1:]
    parser = argparse.ArgumentParser(prog='doctor', description=__doc__.strip())
    parser.add_argument('parameters', type=Path, nargs='*', help='parameter files of the machine')
    files = parser.parse_args(words).parameters or [config_path('manipulator.yaml')]
    return exit_status('doctor', lambda: _report(files, arguments), USAGE_ERROR)


def _report(files: Sequence[Path], arguments: Sequence[str] | None) -> int:
    wrong = 0
    for finding in _findings(files, arguments):
        wrong += not finding.passed
        print('ok   ' if finding.passed else 'WRONG', f'{finding.name}: {finding.message}',
              flush=True)
    return int(wrong > 0)


def _findings(files: Sequence[Path], arguments: Sequence[str] | None) -> Iterator[Finding]:
    yield versions()
    yield clock()
    yield enclaves()
    yield middleware(rclpy.get_rmw_implementation_identifier())
    with ros_errors():
        received = _nodes(arguments)
    yield from received
    read = partial(read_settings, files)
    folders = {read('driver', 'service', ServiceSettings).folder,
               read('recorder', '', BlackBoxSettings).folder}
    for folder in sorted(filter(None, folders)):
        yield writable(Path(folder).expanduser())
    if not any(finding.name.endswith(BUS) for finding in received):  # which knows the driver's own
        yield realtime(read('driver', 'controller', ControllerSettings))


def _nodes(arguments: Sequence[str] | None) -> list[Finding]:
    """Return what the nodes that run say and do."""
    rclpy.init(args=arguments)
    try:
        with ManipulatorClient('', 'doctor') as client:
            client.spin(LISTENING)
            return [publishers(client.node), *components(client)]
    finally:
        rclpy.try_shutdown()


def versions() -> Finding:
    """Say whether what is installed is what this package wants."""
    try:
        wrong = [fault for text in requires(PACKAGE.name) or () if (fault := _fault(text))]
        found = f'{PACKAGE.name} {version(PACKAGE.name)}, Python {sys.version.split()[0]}'
    except PackageNotFoundError:
        wrong, found = [f'{PACKAGE.name} is not installed'], ''
    cure = 'install them, or build the workspace again'
    return _finding('versions', '; '.join(wrong), cure, found)


def _fault(text: str) -> str:
    """Return what is wrong with what is installed of a requirement."""
    wanted = Requirement(text)
    if wanted.marker is not None and not wanted.marker.evaluate({'extra': ''}):
        return ''
    try:
        found = version(wanted.name)
    except PackageNotFoundError:
        return f'{wanted.name} is not installed'
    is_right = wanted.specifier.contains(found, prereleases=True)
    return '' if is_right else f'{wanted.name} is {found}, not {wanted.specifier}'


def clock() -> Finding:
    """Say whether the system clock follows others, by the kernel's word."""
    state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(TIMEX_SIZE))
    return _finding(
        'clock', '' if 0 <= state < TIME_ERROR else 'it is not synchronised: messages of other '
        'computers may be rejected as stale or future', 'start chrony or systemd-timesyncd',
        'synchronised')


def writable(folder: Path) -> Finding:
    """Say whether files can be written to a folder, or where it is to be made."""
    there = next(one for one in (folder, *folder.parents) if one.exists())
    free = shutil.disk_usage(there).free
    if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
        return _finding(str(folder), f'user {os.getuid()} cannot write to {there}',
                        f'sudo chown {os.getuid()} {there}')
    return _finding(
        str(folder), '' if free >= RESERVE else
        f'{1e-6 * free:.0f} MB are free, bound {1e-6 * RESERVE:.0f} MB', 'delete files',
        f'{1e-6 * free:.0f} MB free')


def enclaves() -> Finding:
    """Say whether the nodes' keys are there, where security is switched on."""
    if os.environ.get('ROS_SECURITY_ENABLE') != 'true':
        return Finding('enclaves', True, 'security is off (ROS_SECURITY_ENABLE)')
    store = Path(os.environ.get('ROS_SECURITY_KEYSTORE', '')) / 'enclaves'
    found = [path for name in ENCLAVES for path in store.glob(f'**/{name}') if path.is_dir()]
    missing = [str(path / name) for path in found for name in ENCLAVE_FILES
               if not (path / name).exists()]
    wrong = f'{", ".join(missing)} missing' if missing else '' if found else f'none in {store}'
    return _finding('enclaves', wrong, 'set ROS_SECURITY_KEYSTORE, or make them with ros2 security'
                    ' create_enclave and create_permission', ', '.join(map(str, found)))


def middleware(name: str) -> Finding:
    """Say whether this middleware was tried."""
    return _finding('middleware', '' if name == TRIED_RMW else f'{name} was not tried',
                    f'RMW_IMPLEMENTATION={TRIED_RMW} for every process of the machine',
                    f'{name}, domain {os.environ.get("ROS_DOMAIN_ID", "0")}')


def publishers(node: Node) -> Finding:
    """Say which topics have a second publisher: another driver, supervisor or estimator."""
    wrong = []
    for topic, _ in node.get_topic_names_and_types():
        names = sorted(f'{one.node_namespace.rstrip("/")}/{one.node_name}'
                       for one in node.get_publishers_info_by_topic(topic))
        if topic.endswith(SOLE) and len(names) > 1:
            wrong.append(f'{topic} has {len(names)} publishers: {", ".join(names)}')
    return _finding('publishers', '; '.join(wrong), 'end all but one', 'one for each topic')


def components(client: ManipulatorClient) -> Iterator[Finding]:
    """Say what the nodes say of themselves, of the bus also which share of cycles was late."""
    for namespace, known in sorted(client.gondolas.items()):
        for name, component in sorted(known.items()):
            status, share = component.status, status_values(component.status).get('late share [%]')
            late = '' if share is None else f'; {share} % of cycles late'
            yield Finding(f'{namespace}/{name}'.lstrip('/'), status.level == DiagnosticStatus.OK,
                          f'{status.message}{late}')
    if not client.gondolas:
        yield Finding('nodes', True, 'none runs: start them to have them looked at, too')


def realtime(controller: ControllerSettings) -> Finding:
    """Say whether this user's control loop would have its priority, memory and processor."""
    with ThreadPoolExecutor(1) as thread:  # which alone gets them
        wrong = thread.submit(request_realtime, controller).result()
    if not controller.realtime_priority:
        wrong.append(describe_scheduling(0))
    return Finding('real-time rights', not wrong, '; '.join(wrong) or describe_scheduling(
        controller.realtime_priority))


def _finding(name: str, wrong: str, cure: str, fine: str = '') -> Finding:
    """Return a finding: cause and cure where something is wrong, else what is."""
    return Finding(name, not wrong, f'{wrong}; next: {cure}' if wrong else fine)


if __name__ == '__main__':
    raise SystemExit(main())
