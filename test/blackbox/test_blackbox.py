"""The black box's parts: what is kept, when a file is due, and what is on the disk."""

from __future__ import annotations

from contextlib import contextmanager
import errno
from io import BytesIO
import math
from multiprocessing import Process
import os
from pathlib import Path
import shutil
from socket import AF_INET, SOCK_DGRAM, socket, SOL_SOCKET
import struct
import subprocess
from tempfile import TemporaryDirectory
import time

from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
import pytest

from facade_manipulator.blackbox import (
    CAN_TOPIC,
    frame_bytes,
    Kept,
    messages_of,
    read_recording,
    RecordedTopic,
    RecordTrigger,
    Shelf,
    Stream,
    write_mcap,
    write_recording,
)
from facade_manipulator.blackbox.can_frames import (
    FrameBuffer,
    LONGEST_BATCH,
    SO_TIMESTAMPNS,
    stamp_of,
)
from facade_manipulator.blackbox.recording import metadata_of
from facade_manipulator.blackbox.shelf import RESERVE
from facade_manipulator.blackbox.stream import OVERHEAD
from facade_manipulator.blackbox.trigger import REST, RETRY_AFTER
from facade_manipulator.errors import RecordError
from facade_manipulator.maintenance import CounterFile

messages = st.lists(st.tuples(
    st.floats(0.0, 2.0), st.sampled_from('abc'), st.binary(max_size=400)), max_size=40)
TOPICS = [RecordedTopic(one, 'std_msgs/msg/Bool', 'bool data') for one in 'abc']
ABOUT = {'black box': {'reasons': 'a test', 'namespace': '/'}}


def stream(folder, memory=10**6, duration=1e9, disk=10**9):
    return Stream(folder, 'g', duration, memory, disk)


def read(path):
    reader = make_reader(BytesIO(path.read_bytes()))
    return [(channel.topic, message.log_time, message.publish_time, message.data)
            for _, channel, message in reader.iter_messages(log_time_order=False)]


@settings(max_examples=15, deadline=None)
@given(st.lists(messages, min_size=1, max_size=4), st.booleans())
def test_a_file_of_segments_has_each_message_once_even_after_a_kill(batches, is_killed):
    with TemporaryDirectory() as folder:
        written, now, added = stream(Path(folder)), time.monotonic(), []
        for batch in batches:
            for step, topic, data in batch:
                now += step
                added.append((topic, data))
                written.add(topic, [(now, data)])
            written.flush(ABOUT)
        path = Path(folder) / 'file.mcap'
        if is_killed:
            os.close(written._lock_file)
            assert stream(Path(folder)).recover(
                lambda segments: write_recording(path, TOPICS, segments)) == 1
            assert [one.name for one in Path(folder).iterdir()] == ['file.mcap']
        else:
            assert stream(Path(folder)).recover(pytest.fail) == 0
            write_recording(path, TOPICS, written.since(0.0))
        assert [(topic, data) for topic, _, _, data in read(path)] == added


def test_what_came_before_a_file_is_logged_at_its_begin_and_keeps_its_time(tmp_path):
    written, now = stream(tmp_path, duration=0.0), time.monotonic() + 8 * 3600.0
    for topic, age in (('a', 8 * 3600.0), ('b', 1.0)):
        written.add(topic, [(now - age, b'\0')])
        written.flush(ABOUT)
    path = tmp_path / 'file.mcap'
    write_recording(path, TOPICS, written.since(now - 60.0))
    (_, first, came, _), (_, second, _, _) = read(path)
    assert first == second
    assert 1e-9 * (first - came) == pytest.approx(8 * 3600.0 - 1.0)
    assert len(list(tmp_path.glob('.stream*/*.mcap'))) == 1


def test_while_a_disk_takes_nothing_the_newest_stay_in_memory(tmp_path):
    room = 9 * (OVERHEAD + 16)  # of which 14 say when and how much, and one is the topic's name
    written, folder = stream(tmp_path / 'file' / 'folder', room), tmp_path / 'file'
    folder.write_text('')
    for number in range(30):
        written.add('a', [(float(number), bytes([number]))])
        if number == 20:
            with pytest.raises(OSError):
                written.flush(ABOUT)
        assert written.size <= room
    folder.unlink()
    written.flush(ABOUT)
    write_recording(tmp_path / 'file.mcap', TOPICS, written.since(0.0))
    assert [data[0] for *_, data in read(tmp_path / 'file.mcap')] == list(range(21, 30))
    assert (written.dropped, written.size) == (21, 0)


def test_a_stream_of_another_version_becomes_a_file_without_the_topics_unknown_here(tmp_path):
    written = stream(tmp_path)
    for topic in ('a', 'renamed'):
        written.add(topic, [(1.0, b'1')])
    written.flush(ABOUT)
    write_recording(tmp_path / 'file.mcap', TOPICS, written.since(0.0))
    assert [topic for topic, *_ in read(tmp_path / 'file.mcap')] == ['a']


def test_a_segment_of_which_the_disk_kept_half_costs_itself_alone(tmp_path):
    written, path = stream(tmp_path), tmp_path / 'file.mcap'
    for number in range(3):
        written.add('a', [(float(number), os.urandom(3000))])
        written.flush(ABOUT)
    broken = written.since(0.0)[1]
    broken.write_bytes(broken.read_bytes()[:2000])
    os.close(written._lock_file)
    assert stream(tmp_path).recover(
        lambda segments: write_recording(path, TOPICS, segments)) == 1
    assert len(read(path)) == 2


def test_segments_take_no_more_of_the_disk_than_their_share(tmp_path):
    written = stream(tmp_path, disk=20_000)
    for number in range(30):
        written.add('a', [(float(number), os.urandom(2000))])
        written.flush(ABOUT)
    assert 10_000 < sum(one.stat().st_size for one in written.since(0.0)) <= 20_000


def test_a_file_is_due_some_time_after_the_first_reason_and_names_all():
    trigger = RecordTrigger(60.0, 3.0)
    assert trigger.watch(10.0, 'driver: q1', 'fault 8611h at 3.9 mm')
    assert not trigger.watch(11.0, 'driver: q1', 'fault 8611h at 4.1 mm')  # goes on
    trigger.watch(12.0, 'driver: operation', 'stopped')
    assert not trigger.due(12.9)
    reasons = ('driver: q1: fault 8611h at 3.9 mm', 'driver: operation: stopped')
    assert trigger.due(13.0) == (reasons, 10.0)
    assert not trigger.due(math.inf)
    trigger.rest(13.0, 0.6)
    trigger.watch(20.0, 'driver: q1', 'fault 7305h')
    assert not trigger.due(13.0 + 0.6 * REST - 0.1)
    assert trigger.due(13.0 + 0.6 * REST) == ((*reasons, 'driver: q1: fault 7305h'), 10.0)
    trigger.watch(71.0, 'driver: q2', 'fault 8611h')
    assert trigger.due(74.0) == (('driver: q2: fault 8611h',), 71.0)


def test_a_file_that_could_not_be_written_is_tried_again_after_a_while():
    trigger = RecordTrigger(60.0, 3.0)
    trigger.watch(10.0, 'driver', 'a fault')
    due = trigger.due(13.0)
    trigger.again(13.0, due)
    assert trigger.due(13.0 + 3.0 + RETRY_AFTER - 0.1) is None
    assert trigger.due(13.0 + 3.0 + RETRY_AFTER) == due
    trigger.watch(100.0, 'driver', 'another fault')
    trigger.again(101.0, due)  # that of before is over
    assert trigger.due(103.0).reasons == ('driver: another fault',)


@given(st.lists(st.tuples(st.floats(0.1, 50.0), st.sampled_from('abcdef')), max_size=40))
def test_every_cause_of_a_storm_is_in_a_file_that_covers_it(storm):
    trigger, now, causes, files = RecordTrigger(60.0, 3.0), 0.0, [], []
    for step, cause in [*storm, (1000.0, 'z')]:
        begin, now = now, now + step
        while (at := min(trigger._due, now)) < now:
            files.append((trigger.due(at), at))
            trigger.rest(at, 0.2)
        causes.append((now, f'driver: {cause}'))
        trigger.watch(now - 0.01 * (now - begin), 'driver', '')
        trigger.watch(now, 'driver', cause)
    files.append((trigger.due(math.inf), math.inf))
    assert all(any(due.first <= at <= end and cause in due.reasons for due, end in files)
               for at, cause in causes)
    assert len({due.first for due, _ in files}) <= 1 + (causes[-1][0] / 60.0)


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


@pytest.mark.parametrize('step', [-3600, 3600])
def test_a_clock_that_is_set_within_a_batch_puts_its_frames_into_no_other_time(step):
    batch = b''.join(struct.pack('@llIB3x8s', seconds, 0, 0x181, 0, b'')
                     for seconds in (5000, 5000 + step))
    times = [one.time for one in messages_of(Kept(50.0, 'can_frames', batch))]
    assert 50.0 - LONGEST_BATCH <= times[0] <= times[1] == 50.0


def test_frames_are_received_many_at_once_and_wait_each_with_its_stamp(monkeypatch):
    """From a socket of another kind, which the kernel stamps as well."""
    monkeypatch.setattr('facade_manipulator.blackbox.can_frames.MOST_AT_ONCE', 64)
    monkeypatch.setattr('facade_manipulator.blackbox.can_frames.ROOM', 90)
    sent = [struct.pack('=IB3xq', 0x181, 8, number) for number in range(100)]
    with socket(AF_INET, SOCK_DGRAM) as here, socket(AF_INET, SOCK_DGRAM) as there:
        here.setsockopt(SOL_SOCKET, SO_TIMESTAMPNS, 1)
        here.bind(('127.0.0.1', 0))
        frames, before, batches = FrameBuffer(), time.time(), []
        frames.receive(here.fileno())
        assert frames.take() == b''
        for one in sent:
            there.sendto(one + b'more than fits into a frame', here.getsockname())
        for turns in (3, 1):  # for the third there is no room left
            for _ in range(turns):
                frames.receive(here.fileno())
            assert frames.is_short == (turns == 3)
            batches.append(frames.take())
    assert [len(one) // 32 for one in batches] == [90, 10]
    kept = [one[place:place + 32] for one in batches for place in range(0, len(one), 32)]
    assert [one[16:] for one in kept] == sent
    stamps = [stamp_of(one) for one in kept]
    # the system's clock may be set back a little meanwhile
    assert all(before - 0.05 <= stamp <= time.time() + 0.05 for stamp in stamps)
    with pytest.raises(OSError, match='Bad file descriptor'):
        frames.receive(here.fileno())


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


def test_a_byte_that_the_disk_has_turned_is_found_wherever_it_is(tmp_path):
    path = tmp_path / 'a.mcap'
    write_mcap(path, [CAN_TOPIC], [Kept(5.5, 'can_frames', frame_bytes(5.5, 1, b''))], 1000.0,
               {'black box': {'reasons': 'a test', 'namespace': '/', 'begin': '1.0'}})
    assert read_recording(path).damage == ''
    path.write_bytes(path.read_bytes().replace(b'a test', b'a tast', 1))
    assert 'crc' in read_recording(path).damage.lower()


def fill(size, reason='a test'):
    return lambda path: write_mcap(path, [CAN_TOPIC], [Kept(0.0, 'can_frames', os.urandom(size))],
                                   0.0, {'black box': {'reasons': reason}})


def shelf(folder, name='', limit=1.0):
    folder.mkdir(exist_ok=True, parents=True)
    made = Shelf(str(folder), limit, name)
    return made, lambda *what: made.write(*what, folder / f'{name}.part')


def test_the_oldest_go_even_where_the_clock_began_in_1970(tmp_path):
    _, write = shelf(tmp_path / 'new')
    for stamp in (1e9, 2e9, 5.0, 3e9, 6.0):
        newest = write(stamp, fill(300_000))
    names = sorted(path.name for path in newest.parent.iterdir())
    assert names == ['blackbox_000001_manipulator_20010909T014640Z.mcap',  # first of its cause
                     'blackbox_000004_manipulator_20650124T052000Z.mcap',
                     'blackbox_000005_manipulator_19700101T000006Z.mcap']
    assert newest.name == names[-1]


def test_the_first_file_of_each_cause_outlasts_a_cause_that_repeats(tmp_path):
    _, write = shelf(tmp_path)
    rare = write(0.0, fill(100_000, 'driver: q1: fault 8611h'))
    for number in range(30):
        write(number, fill(100_000, f'driver: late for {number} ms'))
    assert rare.exists()
    assert len(list(tmp_path.iterdir())) == 9


def test_gondolas_and_two_of_one_name_that_write_forty_times_at_once_keep_each_file(tmp_path):
    names = ['gondola_1', 'gondola_2', 'gondola_2']

    def race(number: int) -> None:
        made = Shelf(str(tmp_path), 100.0, names[number])
        for _ in range(40):
            made.write(0.0, fill(10, names[number]), tmp_path / f'{number}.part')

    racers = [Process(target=race, args=(number,)) for number in range(len(names))]
    for one in racers:
        one.start()
    for one in racers:
        one.join()
    files = [(path, metadata_of(path)['black box']['reasons']) for path in tmp_path.iterdir()]
    assert sorted(name for _, name in files) == sorted(names * 40)
    assert all(name in path.name for path, name in files)


def test_a_file_larger_than_the_bound_stays_until_the_next_one(tmp_path):
    _, write = shelf(tmp_path)
    assert write(0.0, fill(3_000_000)).exists()
    write(1.0, fill(10))
    assert len(list(tmp_path.iterdir())) == 1


def test_what_is_not_the_black_boxs_is_left_alone(tmp_path):
    other = tmp_path / 'blackbox_notes.mcap'
    other.write_text('mine')
    shelf(tmp_path)[1](0.0, fill(2_000_000))
    assert other.exists()


def test_own_files_go_before_a_full_disk_is_a_message(tmp_path, monkeypatch):
    _, write = shelf(tmp_path)
    paths = [write(0.0, fill(300_000)) for _ in range(3)]
    usage = shutil.disk_usage(tmp_path)
    lacks = [500_000]
    monkeypatch.setattr(shutil, 'disk_usage', lambda folder: usage._replace(
        free=RESERVE - lacks[0] + 300_000 * (3 - sum(one.exists() for one in paths))))
    write(1.0, fill(10))
    assert [one.exists() for one in paths] == [False, False, True]
    lacks[0] = 10_000_000
    with pytest.raises(RecordError, match='41 MB free, 50 MB are left to others'):
        write(2.0, fill(10))


def test_a_disk_that_fills_while_a_file_is_written_is_a_message(tmp_path):
    def fail(path: Path):
        raise OSError(errno.ENOSPC, 'No space left on device')

    with pytest.raises(RecordError, match='No space left'):
        shelf(tmp_path)[1](0.0, fail)
    assert not list(tmp_path.iterdir())


# --- what a disk has at once after something was written: the power may go then

@contextmanager
def mounted(image: Path, folder: Path):
    folder.mkdir()
    done = subprocess.run(['mount', '-o', 'loop', image, folder], capture_output=True, check=False)
    if done.returncode:
        pytest.skip(f'no file system can be mounted here: {done.stderr.decode().strip()}')
    try:
        yield folder
    finally:
        subprocess.run(['umount', folder], check=True)


@pytest.fixture
def cut(tmp_path):
    """Give a function that writes on an ext4 and returns what is there after a power cut."""
    if os.geteuid() or not shutil.which('mkfs.ext4'):
        pytest.skip('needs root and mkfs.ext4')
    image, copy = tmp_path / 'disk', tmp_path / 'copy'
    with image.open('wb') as file:
        file.truncate(200_000_000)
    subprocess.run(['mkfs.ext4', '-q', image], check=True)

    def run(write) -> dict[str, bytes]:
        with mounted(image, tmp_path / 'before') as folder:
            write(folder)
            shutil.copyfile(image, copy)
        with mounted(copy, tmp_path / 'after') as folder:
            return {path.name: path.read_bytes() for path in folder.rglob('*') if path.is_file()}

    return run


def test_a_file_outlasts_the_power_that_goes_as_soon_as_it_is_written(cut, tmp_path):
    kept = cut(lambda folder: shelf(folder)[1](0.0, fill(1000)))
    path = tmp_path / 'file.mcap'
    path.write_bytes(kept['blackbox_000001_manipulator_19700101T000000Z.mcap'])
    assert path.stat().st_size > 1000


def test_segments_and_counters_outlast_it_and_what_is_not_synced_does_not(cut):
    def write(folder: Path) -> None:
        counting = CounterFile(str(folder), 'a')
        counting.counters.hours = 108.0
        counting.close()
        streamed = stream(folder)
        streamed.add('a', [(1.0, bytes(100))])
        streamed.flush(ABOUT)
        (folder / 'not_synced').write_text('a')
        os.close(streamed._lock_file)  # as a process that ends

    kept = cut(write)
    assert b'108.0' in kept['counters_a.json'] and kept['00000000.mcap']
    assert not kept.get('not_synced')
