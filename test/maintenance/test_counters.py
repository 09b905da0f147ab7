"""Counters of a machine's life: what counts, what is kept, and what a damaged file costs."""

from __future__ import annotations

import json
import math
from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.drives.cia402 import Cause
from facade_manipulator.drives.controller import AxisSnapshot, ControllerSnapshot, ControllerState
from facade_manipulator.errors import InputError
from facade_manipulator.maintenance import (
    CounterFile,
    kept_counters,
    MachineCounters,
    ServiceSettings,
)
from facade_manipulator.maintenance.counters import (
    AxisCounters,
    DEAD_BAND,
    DriveCounters,
    MOST_CAUSES,
    OTHER,
)

ACTIVE, ACTIVATING = ControllerState.ACTIVE, ControllerState.ACTIVATING
STOPPED, INACTIVE = ControllerState.STOPPED, ControllerState.INACTIVE


def snapshot(state=ACTIVE, position=0.0, force=0.0, cause='', homed=True, error=0.0):
    causes = (Cause(cause, 'next'),) if cause else ()
    axis = AxisSnapshot('q1', 1, position=position, force=force, homed=homed,
                        following_error=error)
    return ControllerSnapshot(state, 1.0, (axis,), causes)


def counted(*snapshots, period=0.01):
    counters = MachineCounters()
    for number, one in enumerate(snapshots):
        counters.note(100.0 + number * period, one)
    return counters


@given(st.lists(st.floats(-0.5, 0.5), min_size=2, max_size=50))
def test_travel_is_that_of_all_that_moved_and_reversals_its_turns(positions):
    steps = [0.0]
    last, travel = positions[0], 0.0
    for position in positions[1:]:
        if abs(position - last) >= DEAD_BAND:
            steps.append(position - last)
            travel += abs(position - last)
            last = position
    turns = sum(a * b < 0.0 for a, b in zip(steps, steps[1:], strict=False))
    axis = counted(*(snapshot(position=one) for one in positions)).axes['q1']
    assert axis.travel == pytest.approx(travel)
    assert axis.reversals == turns


@pytest.mark.parametrize(('noise', 'counts'), [(4e-5, False), (6e-5, True)])
def test_noise_of_an_encoder_is_no_travel(noise, counts):
    axis = counted(*(snapshot(position=noise * (k % 2)) for k in range(1000))).axes['q1']
    assert (axis.travel > 0.0, axis.reversals > 0) == (counts, counts)


def test_an_axis_that_is_homed_again_has_not_travelled_there():
    axis = counted(snapshot(position=0.1), snapshot(homed=False, position=7.0),
                   snapshot(position=0.3), snapshot(position=0.31)).axes['q1']
    assert axis.travel == pytest.approx(0.01)


def test_the_mean_load_is_the_cubic_mean_over_the_travel():
    axis = counted(snapshot(), snapshot(position=0.1, force=-10.0),
                   snapshot(position=0.4, force=20.0)).axes['q1']
    assert axis.mean_load == pytest.approx(((0.1 * 10**3 + 0.3 * 20**3) / 0.4) ** (1 / 3))


def test_hours_count_under_power_alone_and_a_gap_is_not_known():
    assert counted(*[snapshot()] * 361, period=0.5).hours == pytest.approx(180.0 / 3600.0)
    assert counted(*[snapshot(INACTIVE)] * 100).hours == 0.0
    assert counted(snapshot(), snapshot(position=0.4), period=50.0).hours == 0.0
    assert counted(snapshot(), snapshot(position=0.4), period=50.0).axes['q1'].travel == 0.0


def test_starts_and_stops_are_counted_once_each_by_cause_without_numbers():
    counters = counted(
        snapshot(INACTIVE), snapshot(ACTIVATING), snapshot(), snapshot(),
        snapshot(STOPPED, cause='late for 331.5 ms'), snapshot(STOPPED, cause='late for 331.5 ms'),
        snapshot(INACTIVE), snapshot(ACTIVATING), snapshot(),
        snapshot(STOPPED, cause='late for 12 ms'))
    assert counters.starts == 2
    assert counters.stops == {'late for … ms': 2}


def test_causes_without_end_do_not_grow_without_end():
    counters = MachineCounters()
    for number in range(3 * MOST_CAUSES):
        counters.note(number, snapshot())
        counters.note(number + 0.5, snapshot(STOPPED, cause='x' * number + '!'))
    assert len(counters.stops) == MOST_CAUSES + 1
    assert counters.stops[OTHER] == 2 * MOST_CAUSES


def worked(**serials):
    """Return counters of axes that have worked for an hour and a kilometre with these drives."""
    counters = MachineCounters()
    for name, number in serials.items():
        counters.axes[name] = AxisCounters(travel=1000.0, drive=number)
        counters.drives[number or name] = DriveCounters(hours=1.0)
    return counters


@pytest.mark.parametrize('part', ['q1_screw', 'q1_drive', 'q2_screw', 'q2_drive'])
def test_each_screw_and_each_drive_has_an_interval_of_its_own(part):
    counters, settings = worked(q1='11', q2=''), ServiceSettings(hours=1.0, travel=1.0)
    assert counters.due(settings).count('is due') == 4
    assert counters.record_service(part) == (
        f'the service interval begins again: {part} after 1.000 '
        f'{"h" if "drive" in part else "km"}')
    assert part not in counters.due(settings) and counters.due(settings).count('is due') == 3
    assert part in str(counters.history)
    counters.record_service()
    assert counters.due(settings) == worked(q1='11').due(ServiceSettings()) == ''
    for name, words in (('q3_screw', 'q3_screw'), ('', 'this machine')):
        with pytest.raises(InputError, match=f'no work of {words} is counted'):
            (counters if name else MachineCounters()).record_service(name)


def test_the_interval_of_a_drive_goes_with_it_and_that_of_the_screw_stays():
    counters, settings = worked(q1='11', q2='12'), ServiceSettings(hours=1.0, travel=1.0)
    counters.record_service('q1_drive')
    counters.axes['q1'].drive, counters.axes['q2'].drive = '12', '11'
    assert [words.split()[2] for words in counters.due(settings).split('; ')] == [
        'q1_screw', 'q1_drive', 'q2_screw']


# --- on the disk

def book(tmp_path):
    return CounterFile(str(tmp_path), '/gondola_1')


def test_what_was_counted_is_there_after_a_kill(tmp_path):
    tmp_path /= 'not/there/yet'
    first = book(tmp_path)
    first.counters.note(1.0, snapshot())
    first.counters.note(1.01, snapshot(position=0.25, error=0.003))
    first.keep(1.01)
    first._job.result(5.0)
    again = book(tmp_path)  # nobody closed the first
    assert again.counters.values() == first.counters.values()
    assert again.counters.axes['q1'].travel == 0.25
    assert not math.isnan(again.counters.axes['q1'].mean_load)
    first.close()


def test_it_is_written_once_a_second_and_only_under_power(tmp_path):
    counting = book(tmp_path)
    counting.counters.note(1.0, snapshot(INACTIVE))
    counting.keep(1.0)
    assert counting._job is None
    counting.counters.note(2.0, snapshot())
    jobs = set()
    for now in (2.0, 2.1, 2.95):
        counting.keep(now)
        job = counting._job
        job.result(5.0)
        jobs.add(job)
    assert len(jobs) == 1
    counting.keep(3.05)
    assert counting._job is not job
    counting.close()


@pytest.mark.parametrize('content', ['', '{', '[]', '{"stops": 3}', '{"axes": {"q1": 2}}'])
def test_a_damaged_file_is_put_aside_and_the_backup_goes_on(tmp_path, content):
    path = tmp_path / 'counters_gondola_1.json'
    path.write_text(content)
    counting = book(tmp_path)
    assert 'begin again at 0' in counting.error
    assert (tmp_path / 'counters_gondola_1.damaged.json').read_text() == content
    counting.counters.hours = 108.0
    counting.close()
    assert json.loads(path.read_text()) == counting.counters.values()
    book(tmp_path).close()  # makes the backup
    path.write_text(content)
    assert book(tmp_path).counters.hours == 108.0


def test_what_a_file_lacks_comes_from_the_backup_or_is_named_and_what_is_unknown_stays(tmp_path):
    path, whole = tmp_path / 'counters_gondola_1.json', worked(q1='11').values() | {'starts': 7}
    path.write_text(json.dumps(whole))
    book(tmp_path).close()
    less = {'hours': 100.0, 'wings': 3, 'axes': {'q1': {'travel': 5.0, 'feathers': 2}}}
    path.write_text(json.dumps(less))
    counting = book(tmp_path)
    assert (counting.counters.starts, counting.counters.drives['11'].hours) == (7, 1.0)
    assert (counting.counters.axes['q1'].drive, counting.error) == ('11', '')
    counting.counters.hours += 1.0
    counting.close()
    kept = json.loads(path.read_text())
    assert (kept['hours'], kept['starts'], kept['wings']) == (101.0, 7, 3)
    assert (kept['axes']['q1']['feathers'], kept['axes']['q1']['travel']) == (2, 5.0)
    (tmp_path / '.counters_gondola_1.backup').unlink()
    path.write_text(json.dumps(less))
    counting = book(tmp_path)
    counting.close()
    assert 'lacks starts, stops, cubed_load of q1' in counting.error  # also once it is written


def test_the_counters_of_a_folder_are_those_that_can_be_read(tmp_path):
    for name, hours in (('/a', 1.0), ('b', 2.0)):
        counting = CounterFile(str(tmp_path), name)
        counting.counters.hours = hours
        counting.close()
    (tmp_path / 'counters_c.json').write_text('[]')
    assert {name: one.hours for name, one in kept_counters(str(tmp_path)).items()} == {
        'counters_a': 1.0, 'counters_b': 2.0}
    assert kept_counters(str(tmp_path / 'nowhere')) == {}


def test_what_was_counted_is_told_in_the_units_of_its_names():
    counters = worked(q1='11')
    axis = counters.axes['q1']
    axis.serviced, axis.cubed_load, axis.reversals = 0.25, 8e6, 7
    axis.greatest_following_error, counters.hours, counters.starts = 0.0125, 3.5, 2
    counters.stops = {'rare': 1, 'frequent': 5}
    lines = dict(counters.lines())
    assert [float(lines[name]) for name in (
        'under power [h]', 'starts', 'q1 travel [km]', 'q1 reversals', 'drive 11 under power [h]',
        'q1 mean load over travel [N]', 'q1 greatest following error [mm]',
        'q1_screw since its service [km]', 'q1_drive since its service [h]')] == [
            3.5, 2, 1.0, 7, 1.0, 20.0, 12.5, 0.75, 1.0]
    assert list(lines)[-2:] == ['stops: frequent', 'stops: rare']


def test_a_file_of_the_version_before_lacks_nothing(tmp_path):
    (tmp_path / 'counters_gondola_1.json').write_text(json.dumps({
        'hours': 100.0, 'starts': 3, 'stops': {}, 'service_hours': 90.0, 'service_travel': 1.0,
        'axes': {'q1': {'travel': 5.0, 'cubed_load': 1.0, 'reversals': 3,
                        'greatest_following_error': 0.001}}}))
    assert book(tmp_path).error == ''


def test_a_driver_of_before_the_exchange_writes_its_drive_no_more(tmp_path):
    first = book(tmp_path)
    first.counters.axes['q1'] = AxisCounters(drive='11')
    first.write()
    first._job.result(5.0)
    second = book(tmp_path)
    second.counters.axes['q1'].drive = '12'
    second.close()
    first.counters.hours += 1.0
    first.close()
    assert book(tmp_path).counters.axes['q1'].drive == '12'


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 5)), max_size=8))
def test_two_drivers_of_a_namespace_lose_nothing_of_each_other(steps):
    with TemporaryDirectory() as folder:
        pair, total = [book(Path(folder)) for _ in range(2)], 0
        for is_second, worked in steps:
            total += worked
            pair[is_second].counters.starts += worked
            pair[is_second].counters.stops['late'] = (
                pair[is_second].counters.stops.get('late', 0) + worked)
            pair[is_second].write()
            pair[is_second]._job.result(5.0)
        for one in pair:
            one.close()
        again = book(Path(folder)).counters
        assert (again.starts, again.stops.get('late', 0)) == (total, total)


def test_a_stop_is_written_at_once_even_without_power(tmp_path):
    counting = book(tmp_path)
    counting.counters.note(1.0, snapshot(INACTIVE))
    counting.counters.note(1.1, snapshot(STOPPED, cause='q2 (node 2): fault 8611h'))
    counting.keep(1.1)
    counting._job.result(5.0)
    assert book(tmp_path).counters.stops == {'q2 (node …): fault 8611h': 1}
    counting.close()


def test_a_drive_keeps_its_hours_on_another_axis_and_the_exchange_is_recorded():
    def with_drive(number):
        one = snapshot()
        return one._replace(axes=(one.axes[0]._replace(serial_number=number),))

    counters = counted(with_drive(11), *[with_drive(11)] * 360, *[with_drive(12)] * 180,
                       with_drive(11), period=1.0)
    assert {number: round(3600 * one.hours) for number, one in counters.drives.items()} == {
        '11': 361, '12': 180}
    assert list(counters.history.values()) == [
        'q1: drive 11 replaced by 12', 'q1: drive 12 replaced by 11']


def test_a_disk_that_takes_nothing_costs_the_counters_alone(tmp_path):
    (tmp_path / 'file').write_text('')
    counting = CounterFile(str(tmp_path / 'file' / 'folder'), '')
    counting.counters.note(1.0, snapshot())
    counting.keep(1.0)
    counting._job.result(5.0)
    assert 'are not kept' in counting.error
    counting.close()


def test_without_a_folder_nothing_is_written():
    counting = CounterFile('', '/gondola_1')
    counting.counters.note(1.0, snapshot())
    counting.keep(1.0)
    counting.close()
    assert counting.error == ''
