"""The journal of a machine: what was written stays, and every change is found again."""

from __future__ import annotations

import json
import os

from hypothesis import given, settings, strategies
import pytest

from facade_manipulator.maintenance import ChangeLog, Journal, journal
from facade_manipulator.maintenance.journal import machine_file

VALUES = strategies.dictionaries(
    strategies.sampled_from('abc'),
    strategies.none() | strategies.booleans() | strategies.floats(allow_nan=False)
    | strategies.text() | strategies.lists(strategies.integers()))


def run(folder, *values):
    """Note values in a run of their own; return what was wrong."""
    history = ChangeLog(str(folder), '/gondola_1')
    for one in values:
        history.note('driver', one)
    history.close()
    return history.error


def journal_in(folder):
    return Journal(machine_file(str(folder), 'changes', 'gondola_1', '.jsonl'))


@settings(max_examples=30)
@given(strategies.lists(strategies.lists(VALUES, max_size=3), max_size=4))
def test_the_last_values_are_known_and_what_stays_adds_nothing(tmp_path_factory, runs):
    folder, last = tmp_path_factory.mktemp('history'), {}
    for values in runs:
        assert run(folder, *values) == ''
        for one in values:
            last.update(one)
        assert journal_in(folder).known('driver') == last
    before = journal_in(folder).entries()
    run(folder, last)
    assert journal_in(folder).entries() == before
    assert all(was != now for entry in before for was, now in entry['changed'].values()
               if was is not None)


def test_a_change_says_from_what_to_what_by_whom_and_when(tmp_path):
    run(tmp_path, {'speed': 0.5})
    run(tmp_path, {'speed': 0.5}, {'speed': 0.6})
    first, second = journal_in(tmp_path).entries()
    assert first['changed'] == {'speed': [None, 0.5]} and second['changed'] == {
        'speed': [0.5, 0.6]}
    assert second['user'] and second['date'] >= first['date'] and second['source'] == 'driver'


def test_a_user_without_a_name_is_known_by_number(tmp_path, monkeypatch):
    def nobody(number):
        raise KeyError(number)

    monkeypatch.setattr(journal.pwd, 'getpwuid', nobody)
    run(tmp_path, {'speed': 0.5})
    assert journal_in(tmp_path).entries()[0]['user'] == str(os.getuid())


@pytest.mark.parametrize('length', [1, 20, -2])
def test_a_line_that_was_torn_costs_itself_alone(tmp_path, length):
    path = tmp_path / 'a.jsonl'
    for name in ('first', 'torn'):
        Journal(path).step(name, '')
    first, torn = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(first + torn[:length])
    assert [entry['check'] for entry in Journal(path).entries()] == ['first']
    Journal(path).step('next', '')
    assert [entry['check'] for entry in Journal(path).entries()] == ['first', 'next']
    assert path.read_bytes().startswith(first + torn[:length])  # nothing is written over


def test_what_is_no_journal_is_named_and_left(tmp_path):
    path = journal_in(tmp_path).path
    path.write_text('just words')
    assert f'{path} is no journal' in run(tmp_path, {'a': 1})
    assert path.read_text() == 'just words'


def test_a_disk_that_cannot_be_written_is_told_and_tried_again(tmp_path):
    (tmp_path / 'file').touch()
    folder = tmp_path / 'file/folder'
    history = ChangeLog(str(folder), '')
    history.note('driver', {'a': 1})
    history._writer.submit(int).result()
    assert 'changes are not kept' in history.error
    (tmp_path / 'file').unlink()
    history.note('driver', {'a': 1})
    history.close()
    assert history.error == ''


def test_the_files_are_bounded_and_the_newest_entries_stay(tmp_path, monkeypatch):
    monkeypatch.setattr(journal, 'LIMIT', 1000)
    for number in range(100):
        Journal(tmp_path / 'a.jsonl').step('check', str(number))
    results = [int(entry['result']) for entry in Journal(tmp_path / 'a.jsonl').entries()]
    assert results == list(range(results[0], 100)) and len(results) > 5
    files = list(tmp_path.iterdir())
    assert len(files) == 2 and all(path.stat().st_size < 1200 for path in files)
    assert all(json.loads(line) for path in files for line in path.read_text().splitlines())
