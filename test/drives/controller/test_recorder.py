import csv
import io
import zipfile

from drive_rig import at_rest, Rig
from frames import encode_rpdo1, encode_tpdo1
from hypothesis import given
from hypothesis import strategies as st
import pytest
from support import wait_until

from facade_manipulator.drives.canopen import pdo
from facade_manipulator.drives.cia402.settings import DEFAULT_AXES
from facade_manipulator.drives.controller.recorder import (
    axis_table,
    candump_lines,
    FaultRecorder,
    FrameRing,
    frames_of,
    Recorded,
    RecorderSettings,
)
from facade_manipulator.drives.controller.snapshot import ControllerState
from facade_manipulator.errors import ParameterError

frames = st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=50)


@given(frames, st.integers(1, 20))
def test_the_ring_gives_back_the_newest_frames_in_order(sent, capacity):
    ring = FrameRing(capacity)
    for number, (cob_id, data) in enumerate(sent):
        ring.add(1.0 + number, cob_id, data)
    expected = [Recorded(1.0 + n, *frame) for n, frame in enumerate(sent)][-capacity:]
    assert frames_of(ring.copy()) == expected


def test_frames_are_logged_as_candump_does():
    lines = list(candump_lines([Recorded(1.5, 0x80, b''), Recorded(2.0, 0x181, b'\x27\x06')], 'c'))
    assert lines == ['(1.500000) c 080#\n', '(2.000000) c 181#2706\n']


def test_the_table_has_a_row_per_sync_with_what_was_known():
    axis = DEFAULT_AXES[0]
    recorded = [
        Recorded(1.00, pdo.SYNC_COB_ID, b''),
        Recorded(1.01, 0x181, encode_tpdo1(0x0627, 8, axis.to_counts(-0.1))),
        Recorded(1.02, 0x201, encode_rpdo1(0x0F, 8, axis.to_counts(-0.099))),
        Recorded(1.03, 0x181, b'short'),
        Recorded(1.04, pdo.SYNC_COB_ID, b''),
    ]
    rows = list(csv.DictReader(io.StringIO(axis_table(recorded, DEFAULT_AXES))))
    assert len(rows) == 2
    assert rows[0]['q1 statusword'] == ''
    assert rows[1]['q1 statusword'] == '0627h'
    assert float(rows[1]['q1 position [m]']) == pytest.approx(-0.1, abs=1e-5)
    assert float(rows[1]['q1 target [m]']) == pytest.approx(-0.099, abs=1e-5)


def recorder(folder, **details) -> FaultRecorder:
    settings = RecorderSettings(
        directory=str(folder), duration=1.0, aftermath=0.5, **details)
    return FaultRecorder(settings, DEFAULT_AXES)


def record(one: FaultRecorder, start: float = 0.0) -> None:
    one.watch((), start)
    one.watch(('it broke',), start + 1.0)
    one.watch(('it broke', 'and then that'), start + 2.0)
    wait_until(lambda: one.last_outcome, 'the record')


def test_a_fault_is_written_with_its_causes_after_the_aftermath(tmp_path):
    one = recorder(tmp_path)
    one.add(1.0, 0x80, b'')
    one.watch(('it broke',), 1.0)
    one.watch(('it broke',), 1.4)
    assert not list(tmp_path.iterdir())
    one.watch(('it broke', 'and then that'), 1.5)
    wait_until(lambda: one.last_outcome, 'the record')
    path, = tmp_path.glob('drive_fault_*.zip')
    assert str(path) in one.last_outcome
    with zipfile.ZipFile(path) as archive:
        assert archive.read('causes.txt') == b'it broke\nand then that\n'
        assert archive.read('candump.log').startswith(b'(1.000000) can0 080#')
        assert archive.read('axes.csv').startswith(b'time [s],q1 controlword')


def test_a_fault_that_was_cleared_at_once_is_written_all_the_same(tmp_path):
    one = recorder(tmp_path)
    one.watch(('it broke',), 1.0)
    one.watch((), 1.2)
    one.watch((), 2.0)
    wait_until(lambda: one.last_outcome, 'the record')
    path, = tmp_path.glob('drive_fault_*.zip')
    with zipfile.ZipFile(path) as archive:
        assert archive.read('causes.txt') == b'it broke\n'


def test_only_the_newest_records_are_kept(tmp_path):
    for number in range(4):
        (tmp_path / f'drive_fault_2020010{number}_000000.zip').write_bytes(b'old')
    record(recorder(tmp_path, max_files=2))
    names = sorted(path.name for path in tmp_path.iterdir())
    assert len(names) == 2
    assert names[0] == 'drive_fault_20200103_000000.zip'


def test_a_folder_that_cannot_be_written_costs_the_record_and_nothing_else(tmp_path):
    (tmp_path / 'file').write_text('not a folder')
    one = recorder(tmp_path / 'file' / 'below')
    record(one)
    assert 'could not be written' in one.last_outcome


def test_a_clock_at_its_epoch_costs_no_record(tmp_path, monkeypatch):
    monkeypatch.setattr('time.time', lambda: 3600.0)
    made = recorder(tmp_path)
    made.add(3599.0, 0x80, b'')
    made.watch(('a fault',), 0.0)
    made.watch(('a fault',), 1e3)
    wait_until(lambda: made.last_outcome, 'the record')
    assert 'is recorded in' in made.last_outcome
    assert list(tmp_path.glob('drive_fault_19*.zip'))


def test_a_record_that_fails_for_any_reason_is_reported_and_no_older_one_is_named(
        tmp_path, monkeypatch):
    made = recorder(tmp_path)
    made.last_outcome = 'the fault is recorded in an older file'
    monkeypatch.setattr(FaultRecorder, '_write_archive', lambda *_: 1 / 0)
    made.watch(('a fault',), 0.0)
    made.watch(('a fault',), 1e3)
    wait_until(lambda: 'could not be written: ZeroDivisionError' in made.last_outcome, 'it')


def test_a_full_disk_leaves_no_half_a_record(tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(zipfile.ZipFile, 'writestr', full)
    one = recorder(tmp_path)
    record(one)
    assert 'No space left' in one.last_outcome
    assert not list(tmp_path.iterdir())


def test_without_a_folder_nothing_is_recorded():
    one = FaultRecorder(RecorderSettings(), DEFAULT_AXES)
    one.watch(('it broke',), 0.0)
    one.watch(('it broke',), 10.0)
    assert not one.is_on
    assert one.last_outcome == ''


def test_a_duration_out_of_bounds_is_rejected():
    with pytest.raises(ParameterError, match='duration'):
        RecorderSettings(duration=0.0)


def test_the_controller_records_the_way_into_a_fault(tmp_path, request):
    settings = RecorderSettings(directory=str(tmp_path), aftermath=0.1)
    rig = Rig(request.node.name, recorder=FaultRecorder(settings, DEFAULT_AXES))
    try:
        at_rest(rig)
        with rig.simulator.access() as drives:
            drives[1].inject_fault(0x8611)
        rig.until(ControllerState.STOPPED)
        wait_until(lambda: 'recorded' in ''.join(rig.controller.snapshot().notes), 'the record')
    finally:
        rig.close()
    path, = tmp_path.glob('drive_fault_*.zip')
    with zipfile.ZipFile(path) as archive:
        rows = list(csv.DictReader(io.StringIO(archive.read('axes.csv').decode())))
        assert b'following error' in archive.read('causes.txt')
        assert b' 082#1186' in archive.read('candump.log')
    assert rows[-1]['q1 controlword'] == '0002h'
    assert '000Fh' in {row['q1 controlword'] for row in rows}
