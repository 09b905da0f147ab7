"""The policies of SROS2 allow each node what the table of interfaces has, and no more."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import pytest

from facade_manipulator import config_path, interfaces
from facade_manipulator.interfaces import NODES, ROLES, SERVICES
from facade_manipulator.tools.policies import main, policies, rights


def allowed(role: str, kind: str, verb: str) -> set[str]:
    return {name for one, what, names in rights(role, {}) if (one, what) == (kind, verb)
            for name in names}


def who_may(kind: str, verb: str, name: str) -> set[str]:
    return {role for role in ROLES if name in allowed(role, kind, verb)}


def test_each_enclave_has_the_rights_of_its_nodes_once():
    root = ElementTree.fromstring(policies('gondola_2'))
    assert len(root.findall('enclaves/enclave')) == len(ROLES) - 2
    profiles = {(enclave.get('path'), one.get('node')): one
                for enclave in root.iter('enclave') for one in enclave.iter('profile')}
    assert {node for _, node in profiles} == {*ROLES}
    for (path, node), profile in profiles.items():
        expected = {'compensator': 'manipulator', 'ik_service': 'manipulator',
                    'doctor': 'viewer'}.get(node, node)
        assert path == f'/gondola_2/{expected}' and profile.get('ns') == '/gondola_2'
        found = [(group.tag, *group.attrib.items(), [one.text for one in group])
                 for group in profile]
        assert found == [(f'{kind}s', (verb, 'ALLOW'), names)
                         for kind, verb, names in rights(node, {})]
        assert all(len({*names}) == len(names) for *_, names in found)


@pytest.mark.parametrize('unit', ['driver', 'manipulator', 'recorder'])
def test_each_service_of_systemd_has_an_enclave(unit):
    text = config_path(f'deploy/systemd/facade-{unit}@.service').read_text('utf-8')
    enclave = re.search(r'--enclave (\S+)', text)[1].replace('%i', 'gondola_1')
    assert f'<enclave path="{enclave}">' in policies('/gondola_1/')


def test_only_ik_service_sends_setpoints_and_only_the_supervisor_calls_what_moves():
    assert who_may('topic', 'publish', 'joint_setpoints') == {'ik_service'}
    for service in SERVICES:
        callers = who_may('service', 'request', service.name)
        assert callers <= {'supervisor'} or service.name.rpartition('/')[2] in interfaces.READ
        assert who_may('service', 'reply', service.name) == {service.server}
    assert not who_may('service', 'request', 'driver/set_parameters')


def test_who_watches_may_read_the_drivers_status_and_moves_nothing():
    readers = who_may('topic', 'subscribe', 'driver/status')
    assert {'supervisor', 'recorder', 'viewer'} <= readers
    of_ros = {'/rosout', '/parameter_events'}
    for viewer in ('viewer', 'doctor'):
        assert allowed(viewer, 'topic', 'publish') == of_ros
    assert allowed('recorder', 'topic', 'publish') - of_ros == {
        '/diagnostics', 'executor_check/message'}
    assert not allowed('estimator', 'topic', 'subscribe')


def test_every_node_may_check_the_faster_executor():
    for verb in ('publish', 'subscribe'):
        assert {*NODES} <= who_may('topic', verb, 'executor_check/message')


def test_a_second_stop_has_its_topic_for_driver_and_supervisor(tmp_path, capsys):
    (tmp_path / 'file.yaml').write_text(
        'driver:\n  ros__parameters:\n    software_stop_topics: [software_stop, watchdog/stop]\n')
    assert main(['gondola_1', '--params-file', str(tmp_path / 'file.yaml')]) == 0
    printed = capsys.readouterr().out
    assert printed.count('<topic>watchdog/stop</topic>') == printed.count(
        '<topic>software_stop</topic>') == 5  # driver, supervisor, recorder, viewer, doctor


def test_sensors_by_names_of_the_users_own_may_be_heard_by_estimator_and_recorder(
        tmp_path, capsys):
    (tmp_path / 'file.yaml').write_text(
        'disturbance_estimator:\n  ros__parameters:\n    distances: [roller, laser]\n'
        "    fixes: ['']\n")
    assert main(['gondola_1', '--params-file', str(tmp_path / 'file.yaml')]) == 0
    printed = capsys.readouterr().out
    for name in ('roller', 'laser', 'imu', 'fix_pose'):
        # estimator, recorder, viewer, doctor, rail_sensors; the simulator has no pose
        assert printed.count(f'<topic>{name}</topic>') == 6 - (name == 'fix_pose')
    assert 'range_1' not in printed and 'fix_x' not in printed


def test_what_is_no_name_no_file_and_no_list_is_named(tmp_path, rejected):
    file = tmp_path / 'file.yaml'
    assert 'file.yaml cannot be read' in rejected(main, ['gondola_1', '--params-file', str(file)])
    file.write_text('driver: {ros__parameters: {software_stop_topics: stop}}\n')
    assert "software_stop_topics = 'stop' is not a list" in rejected(
        main, ['gondola_1', '--params-file', str(file)])
    for namespace in ('two words', '1st'):
        assert f"'{namespace}' is not a name" in rejected(main, [namespace])
