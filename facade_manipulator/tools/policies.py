"""
Print the policies of SROS2 for one manipulator: what the table of interfaces allows, and no more.

There is an enclave for each process and for each program or instrument beside the nodes;
compensator and ik_service are one process.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
import re
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from facade_manipulator import interfaces
from facade_manipulator.errors import exit_status, ParameterError
from facade_manipulator.parameter_file import read_parameters

# else the role
ENCLAVES = {interfaces.COMPENSATOR: 'manipulator', interfaces.IK: 'manipulator',
            interfaces.DOCTOR: interfaces.VIEWER}
Parameters = Mapping[str, Sequence[str]]


def main(args: Sequence[str] | None = None) -> int:
    """Print the policies of a namespace."""
    parser = argparse.ArgumentParser(prog='policies', description=__doc__.splitlines()[1])
    parser.add_argument('namespace', help='of the nodes, such as gondola_1')
    parser.add_argument('--params-file', type=Path, action='append', default=[],
                        help='of driver and disturbance_estimator, where it names topics')
    options = parser.parse_args(args)
    return exit_status('policies', lambda: print(policies(options.namespace, {
        **read_parameters(options.params_file, interfaces.DRIVER),
        **read_parameters(options.params_file, interfaces.ESTIMATOR)})))


def policies(namespace: str, parameters: Parameters = {}) -> str:  # noqa: B006  # read alone
    """Return the policies; parameters of the nodes name topics that have no fixed name."""
    if not re.fullmatch(r'(/?[A-Za-z_][A-Za-z0-9_]*)*/?', namespace):
        raise ParameterError(
            f'namespace {namespace!r} is not a name: letters, digits and _, as gondola_1')
    root = Element('policy', version='0.2.0')
    enclaves = SubElement(root, 'enclaves')
    namespace = f"/{namespace.strip('/')}"
    profiles: dict[str, Element] = {}
    for role in interfaces.ROLES:
        name = ENCLAVES.get(role, role)
        if name not in profiles:
            enclave = SubElement(enclaves, 'enclave', path=f"{namespace.rstrip('/')}/{name}")
            profiles[name] = SubElement(enclave, 'profiles')
        profile = SubElement(profiles[name], 'profile', ns=namespace, node=role)
        for kind, verb, names in rights(role, parameters):
            group = SubElement(profile, f'{kind}s', {verb: 'ALLOW'})
            for one in names:
                SubElement(group, kind).text = one
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding='unicode', xml_declaration=True)


def rights(role: str, parameters: Parameters) -> Iterator[tuple[str, str, list[str]]]:
    """Yield what a role may do: kind of interface, verb of SROS2, names; nothing empty."""
    taken = [one for one in interfaces.TOPICS if may_subscribe(role, one)]
    given = [one for one in interfaces.TOPICS if role in one.publishers]
    for kind, verb, names in (
        ('topic', 'subscribe', [name for one in taken for name in names_of(one, parameters)]),
        ('topic', 'publish', [name for one in given for name in names_of(one, parameters)]),
        ('service', 'request', [one.name for one in interfaces.SERVICES if role in one.clients]),
        ('service', 'reply', [one.name for one in interfaces.SERVICES if role == one.server]),
    ):
        if names:
            yield kind, verb, [*dict.fromkeys(names)]  # two topics may have one parameter


def may_subscribe(role: str, topic: interfaces.Topic) -> bool:
    """Return whether a role may subscribe: a viewer always, the recorder to what it keeps."""
    return role in topic.subscribers or ENCLAVES.get(role, role) == interfaces.VIEWER or (
        role == interfaces.RECORDER and bool(topic.recorded))


def names_of(topic: interfaces.Topic, parameters: Parameters) -> Sequence[str]:
    """Return the names of a topic: its own, or those that a parameter has."""
    names = parameters.get(topic.parameter, (topic.name,))
    if isinstance(names, str) or not isinstance(names, Sequence):
        raise ParameterError(f'{topic.parameter} = {names!r} is not a list of topics')
    return [name for name in names if name]


if __name__ == '__main__':
    raise SystemExit(main())
