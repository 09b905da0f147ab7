"""The black box as a whole, without ROS: what its files say of the machine."""

from __future__ import annotations

import logging
import os
import sys
from threading import Event
import time

import pytest
from support import wait_until

from facade_manipulator.blackbox import (
    BlackBox,
    BlackBoxSettings,
    read_recording,
    RecordedTopic,
    Shelf,
    Stream,
)
from facade_manipulator.blackbox.origin import carried_files
from facade_manipulator.blackbox.recording import metadata_of, segment_messages
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


def test_it_says_what_it_keeps_and_what_it_has_written(make, tmp_path):
    lost = Stream(tmp_path, Shelf(str(tmp_path), 1.0).name, 60.0, 10**6, 1e9)
    lost.add('/a', [(time.monotonic(), TRUE)])
    lost.flush({'black box': {'reasons': '', 'namespace': '/'}})
    os.close(lost._lock_file)  # as a process that ends
    box = make(duration=60.0)
    assert set(box.values().values()) == {0.0, 'nothing recorded yet', tmp_path}
    for age in (5.0, 0.0):
        box.add('/a', [(time.monotonic() - age, os.urandom(1_000_000))])
    assert box.values()['memory [MB]'] == pytest.approx(2.0, abs=0.01)
    path = box.save('asked').result(20.0)
    box._writer.submit(int).result(20.0)  # and what is told of it
    values = box.values()
    assert (values['memory [MB]'], values['messages lost'], box.trouble) == (0.0, 0, '')
    assert 5.0 <= values['kept [s]'] < 25.0
    assert values['stream [MB]'] == pytest.approx(2.0, abs=0.1)
    assert (values['interrupted recordings'], values['files written']) == (1, 1)
    assert values['last file'] == f'recorded in {path}'
    box.add('/a', [(time.monotonic() - 100.0, TRUE)])
    box.save('asked').result(20.0)
    assert box.values()['kept [s]'] <= 60.0 and box._files == 2


def test_a_further_stop_in_the_time_of_a_file_is_added_to_it(make, tmp_path):
    box = make(aftermath=0.0)
    for count, reason in enumerate(('a fault', 'another fault', 'a third'), 1):
        box.add('/a', [(time.monotonic(), TRUE)])
        box.note('driver', reason)
        wait_until(lambda n=count: (box.watch(), box.values()['files written'] == n)[1], reason)
    path, = tmp_path.glob('*.mcap')
    run = read_recording(path)
    assert run.reasons == ['driver: a fault', 'driver: another fault', 'driver: a third']
    assert len(run.topics['a']) == 3 and metadata_of(path)['versions']['mcap']
    assert len(read_recording(path, ['a', 'b']).topics['a']) == 3


def test_a_disk_that_hangs_is_told_and_holds_nobody_up(make, tmp_path, monkeypatch):
    box, ends = make(), Event()
    write = box._shelf.write
    monkeypatch.setattr(box._shelf, 'write', lambda *what: (ends.wait(20.0), write(*what))[1])
    job = box.save('asked')
    assert box.is_writing and box.trouble == ''
    monkeypatch.setattr(sys.modules[BlackBox.__module__], 'LONGEST_WRITE', 0.0)
    assert 'bound 0 s: does the disk hang?' in box.trouble
    box.add('/a', [(time.monotonic(), TRUE)])
    box.note('driver', 'a fault')
    box.watch()  # one file at a time
    assert box._file is job
    ends.set()
    assert job.result(20.0).exists()
    wait_until(lambda: not box.trouble, 'the end of it')
    box.close()
    assert read_recording(sorted(tmp_path.glob('*.mcap'))[1]).reasons == ['driver: a fault']


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
