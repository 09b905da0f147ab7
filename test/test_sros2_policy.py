"""The table of interfaces and config/sros2_policy.xml give each role the same rights."""

from __future__ import annotations

from fnmatch import fnmatchcase
from xml.etree import ElementTree

import pytest

from facade_manipulator import config_path
from facade_manipulator.interfaces import ROLES, SERVICES, TOPICS

NAMESPACE = '/gondola_1'
PARTICIPANTS = sorted({*ROLES} - {'viewer'})
OF_ROS = {'/rosout', '/parameter_events'}
Right = tuple[str, str, str]  # kind, verb, full name


def full(name: str, namespace: str = NAMESPACE) -> str:
    return name if name.startswith('/') else f'{namespace.rstrip("/")}/{name}'


def table(role: str) -> set[Right]:
    """Return the rights that a role needs."""
    services = [one for one in SERVICES if one.server in PARTICIPANTS]
    return {
        *(('topic', 'publish', full(one.name)) for one in TOPICS if role in one.publishers),
        *(('topic', 'subscribe', full(one.name)) for one in TOPICS if role in one.subscribers),
        *(('service', 'reply', full(one.name)) for one in services if role == one.server),
        *(('service', 'request', full(one.name)) for one in services if role in one.clients)}


def enclaves() -> dict[str, str]:
    """Return the path of the enclave by the name of the node."""
    root = ElementTree.parse(config_path('sros2_policy.xml')).getroot()
    return {profile.get('node'): enclave.get('path')
            for enclave in root.iter('enclave') for profile in enclave.iter('profile')}


def expressions(role: str) -> set[Right]:
    """Return what the policy allows a role, with wildcards."""
    root = ElementTree.parse(config_path('sros2_policy.xml')).getroot()
    (profile,) = (one for one in root.iter('profile') if one.get('node') == role)
    return {(one.tag, verb, full(one.text, profile.get('ns')))
            for group in profile for verb, value in group.attrib.items() if value == 'ALLOW'
            for one in group}


def allowed(role: str) -> set[Right]:
    """Return the rights of a role by the names of the table."""
    names = {('topic', full(one.name)) for one in TOPICS}
    names |= {('service', full(one.name)) for one in SERVICES}
    return {(kind, verb, name) for kind, verb, pattern in expressions(role)
            for of_kind, name in names if of_kind == kind and fnmatchcase(name, pattern)}


@pytest.mark.parametrize('role', PARTICIPANTS)
def test_policy_and_table_give_a_role_the_same_rights(role):
    assert allowed(role) == table(role)


@pytest.mark.parametrize('role', PARTICIPANTS)
def test_every_expression_of_the_policy_has_a_name_in_the_table(role):
    stale = {(kind, verb, pattern) for kind, verb, pattern in expressions(role)
             if not any(fnmatchcase(name, pattern) for *_, name in allowed(role))}
    assert not stale


@pytest.mark.parametrize('observer', ['recorder_gondola_1', 'viewer'])
def test_observer_reads_everything_and_commands_nothing(observer):
    rights = allowed(observer)
    assert {name for _, verb, name in rights if verb == 'subscribe'} >= {
        full(one.name) for one in TOPICS if not one.optional}
    assert {name for _, verb, name in rights if verb == 'publish'} == OF_ROS
    assert not [name for _, verb, name in rights if verb == 'request']


def test_compensator_and_ik_service_share_an_enclave():
    paths = enclaves()
    assert paths.pop('compensator') == paths.pop('ik_service') == f'{NAMESPACE}/manipulator'
    assert paths.pop('recorder_gondola_1') == f'{NAMESPACE}/recorder'
    assert paths == {role: f'{NAMESPACE}/{role}' for role in paths}
