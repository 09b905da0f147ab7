"""
Say what is wrong with this computer and with the nodes that run, and what to do about it.

It changes nothing and moves nothing. Exit status: 0 where nothing is wrong, 1 where something is,
2 where it could not look.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
import ctypes
from importlib.metadata import requires
import os
from pathlib import Path
import shutil
import sys

from diagnostic_msgs.msg import DiagnosticStatus
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
import rclpy
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from facade_manipulator import interfaces
from facade_manipulator.blackbox import BlackBoxSettings, RESERVE
from facade_manipulator.diagnostics import BUS
from facade_manipulator.drives.controller import (
    ControllerSettings,
    describe_scheduling,
    request_realtime,
)
from facade_manipulator.errors import exit_status, ParameterError
from facade_manipulator.maintenance import ServiceSettings
from facade_manipulator.nodes.parameter_files import complaints, examine
from facade_manipulator.nodes.settings import DriverSettings
from facade_manipulator.parameter_file import read_settings
from facade_manipulator.resources import (
    config_path,
    installed_versions,
    PACKAGE,
    service_account,
    written_folder,
)
from facade_manipulator.ros import ManipulatorClient, ros_errors, USAGE_ERROR

LISTENING = 4.0  # s: nodes are found within some 1 s, and publish /diagnostics once a second
OWNERS = 0o300  # rights of a folder's owner to write files into it
TRIED_RMW = 'rmw_fastrtps_cpp'
TIMEX_SIZE, TIME_ERROR = 512, 5  # bytes and more than struct timex has; adjtimex(2)
# topics that one node alone may publish
SOLE = (interfaces.DRIVER_STATUS, interfaces.JOINT_STATES, interfaces.JOINT_SETPOINTS,
        interfaces.CORRECTED_POSE, interfaces.DISTURBANCE, interfaces.DISTURBANCE_ODOMETRY)
ENCLAVES = 'driver', 'manipulator', 'recorder'
ENCLAVE_FILES = ('cert.pem', 'key.pem', 'governance.p7s', 'permissions.p7s',
                 'identity_ca.cert.pem', 'permissions_ca.cert.pem')
Findings = Iterator[tuple[str, str]]  # the name, and cause and cure, empty where nothing is wrong


def main(arguments: Sequence[str] | None = None) -> int:
    """Print what was found; return the exit status."""
    words = remove_ros_args(args=sys.argv if arguments is None else ['doctor', *arguments])[1:]
    parser = argparse.ArgumentParser(prog='doctor', description=__doc__.strip())
    parser.add_argument('parameters', type=Path, nargs='*', help='parameter files of the machine')
    parser.add_argument('--namespace', type=lambda it: it.strip('/'), default='',
                        help='of a gondola; without it all there are')
    options = parser.parse_args(words)
    options.parameters = options.parameters or [config_path('manipulator.yaml')]
    return exit_status('doctor', lambda: _report(options, arguments), USAGE_ERROR)


def _report(options: argparse.Namespace, arguments: Sequence[str] | None) -> int:
    findings = []
    for name, wrong in _findings(options, arguments):
        findings.append(wrong)
        print(f'WRONG {name}: {wrong}' if wrong else f'ok    {name}', flush=True)
    return int(any(findings))


def _findings(options: argparse.Namespace, arguments: Sequence[str] | None) -> Findings:
    yield from computer()
    files, namespace = options.parameters, options.namespace
    with ros_errors():
        received = _nodes(namespace, stop_topics(files), arguments)
    yield from received.items()
    given = examine(files, f'/{namespace}' if namespace else None)
    for wrong in complaints(files, given) or ['']:
        yield 'parameters', wrong
    driver = given[interfaces.DRIVER]
    yield from folders(driver.read(ServiceSettings, 'service'),
                       given[interfaces.RECORDER].read(BlackBoxSettings))
    if not any(name.endswith(str(BUS)) for name in received):  # which knows the driver's own
        yield 'real-time rights', realtime(driver.read(ControllerSettings, 'controller'))


def computer() -> Findings:
    """Yield what is known of this computer without its nodes and their parameters."""
    yield 'versions', versions()
    yield 'clock', clock()
    yield 'enclaves', enclaves()
    yield 'middleware', middleware(rclpy.get_rmw_implementation_identifier())


def stop_topics(files: Sequence[Path]) -> tuple[str, ...]:
    """Return the driver's topics of a software stop, the usual one where files cannot be read."""
    with suppress(ParameterError):
        return read_settings(files, interfaces.DRIVER, '', DriverSettings).software_stop_topics
    return DriverSettings().software_stop_topics


def folders(service: ServiceSettings, black_box: BlackBoxSettings) -> Findings:
    """Yield which folders of the nodes' parameters can be written to."""
    for folder in {service.folder, black_box.folder} - {''}:
        path = written_folder(folder)
        yield str(path), unwritable(path)


def _nodes(
    namespace: str, stops: Sequence[str], arguments: Sequence[str] | None
) -> dict[str, str]:
    """Return what the nodes that run say and do, of all namespaces or of one."""
    rclpy.init(args=None if arguments is None else list(arguments))
    try:
        with ManipulatorClient(namespace, interfaces.DOCTOR, enable_rosout=False,
                               start_parameter_services=False) as client:
            client.spin(LISTENING)
            return {'publishers': rivals(client.node, stops)} | {
                f'{one}/{name}'.lstrip('/'):
                    '' if said.status.level == DiagnosticStatus.OK else said.status.message
                for one, known in sorted(client.gondolas.items()) if namespace in ('', one)
                for name, said in sorted(known.items())}
    finally:
        rclpy.try_shutdown()


def versions() -> str:
    """Return what of the packages is not there, or not in the range that this one wants."""
    wanted = [one for one in map(Requirement, requires(PACKAGE.name) or ())
              if one.marker is None or one.marker.evaluate({'extra': ''})]
    there = {canonicalize_name(name): version for name, version in installed_versions().items()}
    wrong = [f'{one.name} is {found or "missing"}, not {one.specifier}' for one in wanted
             if not (found := there.get(canonicalize_name(one.name), ''))
             or not one.specifier.contains(found, prereleases=True)]
    return f'{"; ".join(wrong)}; next: install them' if wrong else ''


def clock() -> str:
    """Return that the system clock follows no other, by the kernel's word."""
    state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(TIMEX_SIZE))
    return '' if 0 <= state < TIME_ERROR else (
        'it is not synchronised: messages of other computers may be rejected as stale or future; '
        'next: start chrony or systemd-timesyncd')


def unwritable(folder: Path) -> str:
    """Return why the nodes can write no file to a folder, which may still have to be made."""
    there = next(one for one in (folder, *folder.parents) if os.path.exists(one))
    if not there.is_dir():
        return f'{there} is no folder; next: move it away'
    account, found = service_account(), there.stat()
    user, may_write = 'this user', os.access(there, os.W_OK | os.X_OK)
    if account is not None and account.pw_uid != os.getuid():
        user = account.pw_name
        may_write = found.st_uid == account.pw_uid and found.st_mode & OWNERS == OWNERS
    if not may_write:
        owner = os.getuid() if account is None else account.pw_name
        return f'{user} cannot write to {there}; next: sudo install -d -o {owner} {folder}'
    free = shutil.disk_usage(there).free
    return '' if free >= RESERVE else (
        f'{1e-6 * free:.0f} MB are free, bound {1e-6 * RESERVE:.0f} MB; next: delete files')


def enclaves() -> str:
    """Return which keys of the nodes are missing, where security is switched on."""
    if os.environ.get('ROS_SECURITY_ENABLE') != 'true':
        return ''
    store = Path(os.environ.get('ROS_SECURITY_KEYSTORE', '')) / 'enclaves'
    found = [path for name in ENCLAVES for path in store.glob(f'**/{name}')]
    missing = [str(path / name) for path in found for name in ENCLAVE_FILES
               if not (path / name).exists()] or ([] if found else [f'any enclave in {store}'])
    return '' if not missing else (
        f'missing: {", ".join(missing)}; next: set ROS_SECURITY_KEYSTORE, or make them with '
        'ros2 security create_enclave, create_permission')


def middleware(name: str) -> str:
    """Return that a middleware was not tried."""
    return '' if name == TRIED_RMW else (
        f'{name} was not tried; next: RMW_IMPLEMENTATION={TRIED_RMW} for every process')


def rivals(node: Node, stops: Sequence[str]) -> str:
    """Return which topics have a second publisher: another driver, supervisor or estimator."""
    names = {f'/{name.lstrip("/")}' for name in (*(one.name for one in SOLE), *stops)}
    senders = {topic: sorted(
        f'{one.node_namespace.rstrip("/")}/{one.node_name}'
        for one in node.get_publishers_info_by_topic(topic))
        for topic, _ in node.get_topic_names_and_types() if topic.endswith(tuple(names))}
    for topic in [*senders]:
        poses = [one for one in senders[topic] if not one.endswith(interfaces.SIMULATOR)]
        odometry = senders.get(f'{topic}_odometry')  # the simulator is silent beside it
        if poses and odometry:
            senders[f'{topic} or {topic}_odometry'] = [*poses, *odometry]
    return ''.join(f'{topic} is published by {", ".join(nodes)}; next: end all but one. '
                   for topic, nodes in senders.items() if len(nodes) > 1).strip()


def realtime(controller: ControllerSettings) -> str:
    """Return what of priority, memory and processor this user's control loop would not have."""
    with ThreadPoolExecutor(1) as thread:  # which alone gets them
        wrong = thread.submit(request_realtime, controller).result()
    return '; '.join(wrong) or ('' if controller.realtime_priority else describe_scheduling(0))


if __name__ == '__main__':
    raise SystemExit(main())
