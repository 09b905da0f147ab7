"""The parameter file that `commission` reads and writes."""

from __future__ import annotations

import pytest

from facade_manipulator.errors import ParameterError
from facade_manipulator.tools.commissioning.machine import Machine


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
    with pytest.raises(ParameterError, match=f'machine.yaml.*{reason}'):
        Machine(path).axis('q1')


def test_two_axes_with_one_node_id_are_rejected(tmp_path):
    path = tmp_path / 'machine.yaml'
    path.write_text('/**/driver: {ros__parameters: {q2.node_id: 3}}')
    with pytest.raises(ParameterError, match='two axes have the same node_id'):
        Machine(path).axes  # noqa: B018 - reads them
