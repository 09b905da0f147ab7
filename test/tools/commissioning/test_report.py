"""Command `report`: what it knows of the machine, and what it misses."""

from __future__ import annotations

import json
import re

import pytest

from facade_manipulator.errors import ParameterError
from facade_manipulator.maintenance import MachineCounters
from facade_manipulator.maintenance.counters import AxisCounters, DriveCounters
from facade_manipulator.resources import version
from facade_manipulator.tools.commissioning import Machine


def test_a_machine_that_was_only_scanned_misses_all_the_rest(make_rig, capsys):
    rig = make_rig().configured()
    rig.run('scan')
    assert rig.run('report') == 1
    page = (rig.folder / 'machine.report.md').read_text()
    assert '- commission direction q2: never done' in page
    assert 'q1: node 1 has serial number 1, the parameter file 0' in page
    assert 'Simulated CiA 402 drive' in page
    assert 'commission scan: never done' not in page
    assert f'version {version()}' in page and re.search(
        r'Checksums: machine.yaml [0-9a-f]{8}, simulated.yaml [0-9a-f]{8}, cia402.eds ', page)


def test_measured_values_and_defaults_are_told_apart(make_rig):
    rig = make_rig().configured()
    Machine(rig.parameters).write({'q1': {'lead': 0.0123}})
    rig.run('report')
    lines = (rig.folder / 'machine.report.md').read_text().splitlines()
    row = {line.split(' | ')[0].strip('| '): line for line in lines if line.startswith('| ')}
    assert row['lead'].endswith('| measured |') and '0.0123' in row['lead']
    assert row['max_speed'].endswith('| default |')
    assert row['gear_ratio'].endswith('| paper |')


def test_a_check_that_failed_stays_open_until_it_passes(make_rig):
    rig = make_rig().configured()
    machine = Machine(rig.parameters)
    machine.note('home-switch', 'spread 0.5 mm', passed=False, axis='q1')
    rig.run('report')
    assert '- commission home-switch q1: spread 0.5 mm' in machine.beside('.report.md').read_text()
    machine.note('home-switch', 'spread 0.01 mm', axis='q1')
    rig.run('report')
    page = machine.beside('.report.md').read_text()
    assert '- commission home-switch q1' not in page
    assert page.count('spread') == 2


def test_the_counters_of_the_machine_are_shown_with_what_is_due(make_rig):
    rig = make_rig().configured()
    Machine(rig.parameters).write({'service': {'folder': str(rig.folder), 'hours': 100.0}})
    (rig.folder / 'counters_gondola_1.json').write_text(json.dumps(MachineCounters(
        hours=123.4, stops={'q1: following error': 2}, axes={'q1': AxisCounters()},
        drives={'q1': DriveCounters(123.4)}).values()))
    (rig.folder / 'counters_gondola_2.json').write_text('damaged')
    rig.run('report')
    page = (rig.folder / 'machine.report.md').read_text()
    assert '| counters_gondola_1 |' in page and 'gondola_2' not in page
    for row in ('| under power [h] | 123.40 |', '| stops: q1: following error | 2 |',
                '| service | service of q1_drive is due: 123.4 h since the last, bound 100 h |',
                '| intervals | 100 h, 0 km; 0: never |'):
        assert row in page


def test_a_journal_that_is_none_is_named_and_left_alone(make_rig, rejected):
    rig = make_rig().configured()
    path = rig.folder / 'machine.journal.jsonl'
    path.write_text('just words')
    assert 'is no journal' in rejected(rig.run, 'report')
    assert path.read_text() == 'just words'


@pytest.mark.parametrize('content, reason', [
    ('/**: {ros__parameters: {geometry: {stroke: 0.5}}}', 'stroke'),
    ('/**: {ros__parameters: {geometry: {stroke: [0.5]}}}', 'stroke has 1 elements, expected 2'),
    ('/**: {ros__parameters: {geometry: {stroke: }}}', '.*geometry.stroke has no value'),
    ('/**: {ros__parameters: {geometry: 1.0}}', 'it is not a table'),
    ('/**/driver: {ros__parameters: {q1: [1]}}', 'it is not a table'),
    ('/**/driver: {ros__parameters: {q1: {2: 3}}}', 'there is no parameter q1.2'),
    ('/**/driver: {ros__parameters: {limit: {speed: 3}, q1: {nodeid: 1}}}',
     "there is no parameter q1.nodeid: did you mean 'node_id'"),
])
def test_a_parameter_file_with_a_malformed_section_is_one_message(tmp_path, content, reason):
    path = tmp_path / 'machine.yaml'
    path.write_text(content)
    with pytest.raises(ParameterError, match=f'machine.yaml.*: {reason}'):
        Machine(path).axis('q1')


def test_two_axes_with_one_node_id_are_rejected(tmp_path):
    path = tmp_path / 'machine.yaml'
    path.write_text('/**/driver: {ros__parameters: {q2.node_id: 3}}')
    with pytest.raises(ParameterError, match='two axes have the same node_id'):
        Machine(path).axes  # noqa: B018 - reads them
