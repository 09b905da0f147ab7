"""Each finding says what is wrong and what to do; the exit status says it, too."""

import os
import subprocess
import sys
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import pytest
from qualities import DRIVER_STATUS

from facade_manipulator.blackbox import RESERVE
from facade_manipulator.drives.controller import ControllerSettings
from facade_manipulator.tools import doctor

DOCTOR = sys.executable, '-m', 'facade_manipulator.tools.doctor'


def test_what_nodes_say_second_publishers_and_unknown_parameters_are_found(ros, tmp_path):
    machine = tmp_path / 'machine.yaml'
    machine.write_text('/**/driver: {ros__parameters: {limits: {nonsense: 1.0}, q1: {lead: 1}}}')
    for name in ('driver', 'other'):
        ros.node(name, namespace='g').create_publisher(DiagnosticStatus, DRIVER_STATUS, 1)
    node = ros.node()
    publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
    message = DiagnosticArray(status=[
        DiagnosticStatus(name='g/driver: bus', level=DiagnosticStatus.WARN, message='late'),
        DiagnosticStatus(name='g/driver: q1', message='switched on'),
        DiagnosticStatus(name='other/driver: q1', message='switched on')])
    node.create_timer(0.1, lambda: publisher.publish(message))
    process = subprocess.Popen([*DOCTOR, str(machine), '--namespace', 'g'],
                               stdout=subprocess.PIPE, text=True)
    ros.until(lambda: ('doctor', '/g') in node.get_node_names_and_namespaces(), 'the doctor', 40.0)
    services = dict(node.get_service_names_and_types_by_node('doctor', '/g'))
    assert not any('parameter' in name for name in services)
    ros.until(lambda: process.poll() is not None, 'the end', 40.0)
    found = process.stdout.read().splitlines()
    assert process.returncode == 1
    assert 'WRONG g/driver: bus: late' in found
    assert 'ok    g/driver: q1' in found and 'ok    other/driver: q1' not in found
    assert {'WRONG parameters: driver: q1.lead = 1 is an integer, expected a double: write 1.0',
            "WRONG parameters: driver has no parameter 'limits.nonsense' (in machine.yaml): did "
            "you mean 'limits.speed'?"} <= {*found}
    assert ('WRONG publishers: /g/driver/status is published by /g/driver, /g/other; '
            'next: end all but one.') in found
    assert not any('real-time rights' in line for line in found)  # the driver has its own


def test_a_keystore_that_is_not_there_is_named_and_the_rest_cannot_be_looked_at(ros_domain):
    done = subprocess.run(DOCTOR, capture_output=True, text=True, check=False, env={
        **os.environ, 'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_STRATEGY': 'Enforce',
        'ROS_SECURITY_KEYSTORE': '/nowhere'})
    assert done.returncode == 2
    assert 'WRONG enclaves: missing: any enclave in /nowhere/enclaves; next: set' in done.stdout
    assert 'is this enclave in its keystore?' in done.stderr and 'Traceback' not in done.stderr


def test_a_part_of_a_key_that_is_missing_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.setenv('ROS_SECURITY_KEYSTORE', str(tmp_path))
    enclave = tmp_path / 'enclaves/g/driver'
    enclave.mkdir(parents=True)
    for name in doctor.ENCLAVE_FILES:
        (enclave / name).touch()
    assert doctor.enclaves() == ''
    (enclave / 'key.pem').unlink()
    assert doctor.enclaves().startswith(f'missing: {enclave}/key.pem; next: ')


@pytest.mark.parametrize('found, wrong', [
    ('99.0', 'thing is 99.0, not <2,>=1; next'), ('1.5', ''),
    ('', 'thing is missing, not <2,>=1; next')])
def test_a_package_of_another_version_is_named(monkeypatch, found, wrong):
    monkeypatch.setattr(doctor, 'requires', lambda _: ['thing>=1,<2', 'other; extra == "test"'])
    monkeypatch.setattr(
        doctor, 'installed_versions', lambda: {'Thing': found} if found else {})
    assert doctor.versions().partition(': install')[0] == wrong


@pytest.mark.parametrize('state, is_right', [(0, True), (4, True), (5, False), (-1, False)])
def test_the_clock_is_as_the_kernel_says(monkeypatch, state, is_right):
    library = type('Library', (), {'adjtimex': staticmethod(lambda timex: state)})
    monkeypatch.setattr(doctor.ctypes, 'CDLL', lambda _: library)
    assert (doctor.clock() == '') == is_right


def test_a_folder_that_is_not_writable_or_full_is_named(tmp_path, monkeypatch):
    folder = tmp_path / 'not made yet'
    assert doctor.unwritable(folder) == ''
    monkeypatch.setattr(doctor.shutil, 'disk_usage', lambda _: type(
        'usage', (), {'free': RESERVE - 1}))
    assert 'bound 50 MB' in doctor.unwritable(folder)
    monkeypatch.setattr(doctor.os, 'access', lambda *_: False)
    assert doctor.unwritable(folder) == (
        f'this user cannot write to {tmp_path}; next: sudo install -d -o {os.getuid()} {folder}')
    (tmp_path / 'file').touch()
    assert doctor.unwritable(tmp_path / 'file/below') == (
        f'{tmp_path / "file"} is no folder; next: move it away')


def test_a_folder_of_the_services_is_for_their_account_to_write_to(tmp_path, monkeypatch):
    uid = os.getuid()
    for other, wrong in ((uid, ''), (uid + 1, f'box cannot write to {tmp_path}; next: sudo '
                                              f'install -d -o box {tmp_path / "new"}')):
        account = SimpleNamespace(pw_name='box', pw_uid=other)
        monkeypatch.setattr(doctor, 'service_account', lambda account=account: account)
        monkeypatch.setattr(doctor.os, 'getuid', lambda: uid + 2)  # an operator
        assert doctor.unwritable(tmp_path / 'new') == wrong


@pytest.mark.parametrize('publishers, wrong', [
    ({'/g/disturbance': ['a'], '/h/disturbance_odometry': ['a']}, ''),
    ({'/g/disturbance_odometry': ['a', 'b']}, '/g/disturbance_odometry is published by /a, /b'),
    ({'/g/disturbance': ['a'], '/g/disturbance_odometry': ['b']},
     '/g/disturbance or /g/disturbance_odometry is published by /a, /b'),
    ({'/g/disturbance': ['gondola_simulator'], '/g/disturbance_odometry': ['b']}, ''),
    ({'/g/software_stop': ['a'], '/g/watchdog/stop': ['b']}, ''),
    ({'/g/watchdog/stop': ['a', 'b']}, '/g/watchdog/stop is published by /a, /b'),
    ({'/g/tool_stop': ['a', 'b']}, ''),
])
def test_whoever_publishes_what_another_one_does_is_named(publishers, wrong):
    node = SimpleNamespace(
        get_topic_names_and_types=lambda: [(topic, []) for topic in publishers],
        get_publishers_info_by_topic=lambda topic: [
            SimpleNamespace(node_namespace='/', node_name=name) for name in publishers[topic]])
    assert doctor.rivals(node, ['software_stop', 'watchdog/stop']) == (
        wrong and f'{wrong}; next: end all but one.')


def test_a_priority_that_is_rejected_comes_with_its_cure(monkeypatch):
    wish = ControllerSettings(realtime_priority=50)
    monkeypatch.setattr(os, 'sched_setscheduler', _reject)
    assert 'priority 50 is rejected' in doctor.realtime(wish)
    assert 'LimitRTPRIO' in doctor.realtime(wish)
    monkeypatch.setattr(os, 'sched_setscheduler', lambda *_: None)
    assert doctor.realtime(wish) == ''
    assert 'set controller.realtime_priority' in doctor.realtime(ControllerSettings())


def _reject(*_):
    raise PermissionError(1, 'Operation not permitted')


def test_another_middleware_than_the_tried_one_is_named():
    assert doctor.middleware(doctor.TRIED_RMW) == ''
    assert 'rmw_other was not tried; next: RMW_' in doctor.middleware('rmw_other')
