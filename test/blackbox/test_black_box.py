"""The black box as a whole, without ROS: what its files say of the machine."""

from __future__ import annotations

import logging
import time

import pytest

from facade_manipulator.blackbox import BlackBox, BlackBoxSettings, read_recording, RecordedTopic
from facade_manipulator.blackbox.origin import carried_files
from facade_manipulator.blackbox.recording import segment_messages
from facade_manipulator.resources import config_path

TOPICS = [RecordedTopic('/a', 'std_msgs/msg/Bool', 'bool data')]
TRUE = b'\0\1\0\0\1'


@pytest.fixture
def make(tmp_path):
    made = []

    def make(name='', parameters=None, collect=int, **values):
        made.append(BlackBox(BlackBoxSettings(folder=str(tmp_path), **values), name, TOPICS,
                             lambda: parameters or {}, collect, logging.getLogger('test')))
        return made[-1]

    yield make
    for one in made:
        one.close()


def test_a_file_has_messages_parameters_versions_host_and_drive_type(make):
    box = make('/g', {'driver': {'q1.profile': 'epos4', 'q1.node_id': 7}})
    box.add('/a', [(time.monotonic(), TRUE)])
    run = read_recording(box.save('asked').result(20.0))
    assert (run.reasons, run.parameters['driver']['q1.node_id']) == (['asked'], 7)
    assert [one.message.data for one in run.topics['/a']] == [True]
    assert run.about['host'] and run.about['namespace'] == '/g'
    assert abs(float(run.about['begin']) - time.time()) < 60.0
    assert {'epos4.yaml'} < set(run.files) and 'outcome' not in box.values()
    assert box.outcome.startswith('recorded in')


def test_after_a_stop_what_came_is_on_the_disk_before_the_file_is_due(make, tmp_path):
    box = make(aftermath=60.0, collect=lambda: box.add('/a', [(time.monotonic(), TRUE)]))
    box.watch()
    box.note('driver', 'a fault')
    box._writer.submit(int).result(20.0)
    box.watch()
    box._writer.submit(int).result(20.0)
    assert [len(segment_messages(path, False)) for path in sorted(
        tmp_path.glob('.stream*/*.mcap'))] == [1, 1]  # of what had to be collected
    assert not list(tmp_path.glob('*.mcap'))
    box.close()  # writes what is due
    run = read_recording(*tmp_path.glob('*.mcap'))
    assert run.reasons == ['driver: a fault'] and len(run.topics['a']) == 3


def test_own_drive_types_and_parameter_files_are_carried_missing_ones_are_not(tmp_path):
    own = tmp_path / 'own.yaml'
    own.write_text(config_path('drives/epos4.yaml').read_text())
    eds = config_path('drives/epos4.yaml').parent.glob('*.eds')
    for path in eds:
        (tmp_path / path.name).write_bytes(path.read_bytes())
    files = carried_files({'q1.profile': str(own), 'q2.profile': 'no_such', 'q1.node_id': 1},
                          ['--ros-args', '--params-file', str(own), '--params-file', 'none.yaml'])
    assert files[0] == files[-1] == own and files[1].suffix == '.eds'
    assert len(files) == 3 and files[1].parent == tmp_path
