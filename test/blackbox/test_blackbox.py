"""The black box's parts: what is kept, when a file is due, and what is on the disk."""

from __future__ import annotations

import errno
from io import BytesIO
from pathlib import Path
import shutil
import struct
from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
import pytest

from facade_manipulator.blackbox import (
    Arrivals,
    CAN_TOPIC,
    frame_bytes,
    Kept,
    MessageRing,
    messages_of,
    RecordTrigger,
    Shelf,
    write_mcap,
)
from facade_manipulator.blackbox.ring import OVERHEAD
from facade_manipulator.blackbox.shelf import RESERVE
from facade_manipulator.errors import RecordError

messages = st.lists(st.tuples(
    st.floats(0.0, 2.0), st.sampled_from('abc'), st.binary(max_size=400)), max_size=60)


@given(messages, st.floats(0.1, 5.0), st.integers(300, 5000))
def test_a_ring_keeps_the_newest_within_time_and_memory_and_the_last_of_each_topic(
        steps, duration, capacity):
    ring, added, now = MessageRing(duration, capacity), [], 0.0
    for step, topic, data in steps:
        now += step
        added.append(Kept(now, topic, data))
        ring.add(*added[-1])
    assert ring.size <= capacity
    assert ring.span <= duration + 1e-9
    before, kept = ring.copy()
    gone = len(added) - len(kept)
    assert (before, kept) == (last_of_each(added[:gone]), added[gone:])
    assert ring.size == sum(len(one.data) + OVERHEAD for one in kept)


def last_of_each(added):
    return sorted({one.topic: one for one in added}.values())


def test_a_file_is_due_some_time_after_the_first_reason_and_names_all():
    trigger = RecordTrigger(3.0, 60.0)
    trigger.watch(10.0, 'driver: q1', 'fault 8611h')
    trigger.watch(11.0, 'driver: q1', 'fault 8611h, 4.1 mm')  # goes on
    trigger.watch(12.0, 'driver: operation', 'stopped')
    assert not trigger.due(12.9)
    assert trigger.due(13.0) == ('driver: q1: fault 8611h', 'driver: operation: stopped')
    assert not trigger.due(1e9)


def test_a_fault_that_comes_and_goes_is_recorded_once_in_a_while():
    trigger, files = RecordTrigger(1.0, 60.0), []
    for second in range(600):
        trigger.watch(second, 'driver: q1', 'late' if second % 2 else '')
        files += [second] if trigger.due(second) else []
    assert len(files) == 10


def test_a_batch_of_frames_is_their_messages_at_their_times():
    frames = [(1000.25, 0x181, b'carriage', {}), (1000.26, 0x12345, b'', {'is_extended': True}),
              (1000.265, 0x701, b'', {'is_rtr': True}), (1000.27, 4, b'\1', {'is_error': True})]
    flags = {'is_extended': 1 << 31, 'is_rtr': 1 << 30, 'is_error': 1 << 29}
    batch = b''.join(
        struct.pack('@ll', 1000, round(1e9 * (stamp - 1000))) + struct.pack(
            '=IB3x8s', cob_id | sum(flags[one] for one in flag), len(data), data)
        for stamp, cob_id, data, flag in frames)
    assert [one.data for one in messages_of(Kept(50.27, 'can_frames', batch))] == [
        frame_bytes(stamp, cob_id, data, **flag) for stamp, cob_id, data, flag in frames]
    assert [one.time for one in messages_of(Kept(50.27, 'can_frames', batch))] == pytest.approx(
        [50.25, 50.26, 50.265, 50.27])


@pytest.mark.parametrize('step', [0.0, 3600.0, -3600.0])
def test_a_clock_that_is_set_puts_nothing_into_another_time(monkeypatch, step):
    clock = SimpleNamespace(monotonic=lambda: 20.0, time=lambda: 1020.0)
    monkeypatch.setattr('facade_manipulator.blackbox.arrivals.time', clock)
    arrivals = Arrivals()
    clock.monotonic, clock.time = lambda: 20.1, lambda: 1020.1 + step
    arrivals.begin()
    assert arrivals.time(1020.04) == pytest.approx({0.0: 20.04, 3600.0: 20.0, -3600.0: 20.1}[step])


@pytest.mark.parametrize('compact', [True, False])
def test_a_reader_of_other_make_reads_what_was_written(tmp_path, compact):
    data = b'\x01\x81' if compact else bytes(range(8))
    path = tmp_path / 'a.mcap'
    write_mcap(path, [CAN_TOPIC], [Kept(5.5, 'can_frames', frame_bytes(
        1005.5, 0x181, data, is_error=compact))], 1000.0, {'black box': {'reasons': 'a test'}})
    reader = make_reader(BytesIO(path.read_bytes()), decoder_factories=[DecoderFactory()])
    ((schema, channel, message, frame),) = reader.iter_decoded_messages()
    assert (schema.name, channel.topic) == ('can_msgs/msg/Frame', 'can_frames')
    assert message.log_time == 1_005_500_000_000
    assert (frame.header.stamp.sec, frame.header.stamp.nanosec) == (1005, 500_000_000)
    assert (frame.id, frame.dlc, frame.is_error) == (0x181, len(data), compact)
    assert bytes(frame.data)[:frame.dlc] == data
    (record,) = reader.iter_metadata()
    assert record.metadata == {'reasons': 'a test'}


def fill(size):
    return lambda path: path.write_bytes(bytes(size))


def test_the_oldest_go_even_where_the_clock_began_in_1970(tmp_path):
    shelf = Shelf(tmp_path / 'new' / 'folder', 1.0)
    for stamp in (2e9, 5.0, 3e9, 6.0):
        newest = shelf.write(stamp, fill(400_000))
    names = sorted(path.name for path in shelf.folder.iterdir())
    assert names == ['blackbox_000003_20650124T052000Z.mcap',
                     'blackbox_000004_19700101T000006Z.mcap']
    assert newest.name == names[-1]


def test_a_file_larger_than_the_bound_stays_until_the_next_one(tmp_path):
    shelf = Shelf(str(tmp_path), 1.0)
    assert shelf.write(0.0, fill(3_000_000)).exists()
    shelf.write(1.0, fill(10))
    assert len(list(tmp_path.iterdir())) == 1


def test_what_is_not_the_black_boxs_is_left_alone(tmp_path):
    other = tmp_path / 'blackbox_notes.mcap'
    other.write_text('mine')
    Shelf(str(tmp_path), 1.0).write(0.0, fill(2_000_000))
    assert other.exists()


def test_a_full_disk_is_a_message_and_leaves_no_half_file(tmp_path, monkeypatch):
    shelf = Shelf(str(tmp_path), 1.0)

    def fail(path: Path):
        path.write_bytes(b'half')
        raise OSError(errno.ENOSPC, 'No space left on device')

    with pytest.raises(RecordError, match='No space left'):
        shelf.write(0.0, fail)
    assert not list(tmp_path.iterdir())
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, 'disk_usage', lambda _: usage._replace(free=RESERVE - 1))
    with pytest.raises(RecordError, match='50 MB free, 50 MB are left to others'):
        shelf.write(0.0, fill(1))


def test_a_folder_that_cannot_be_is_named(tmp_path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(RecordError, match='file/folder'):
        Shelf(str(tmp_path / 'file' / 'folder'), 1.0).write(0.0, fill(1))
