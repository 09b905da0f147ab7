"""One archive has what somebody far away needs."""

import os
from pathlib import Path
import tarfile
from types import SimpleNamespace

from facade_manipulator import resources
from facade_manipulator.tools import support
from facade_manipulator.tools.support import main


def test_an_archive_has_files_counters_logs_parameters_and_versions(
        tmp_path, monkeypatch, ros_domain):
    state, logs = tmp_path / 'state', tmp_path / 'log'
    for folder in (state, logs):
        folder.mkdir()
    old, new = state / 'blackbox_000001_a.mcap', state / 'blackbox_000002_a.mcap'
    counters, log, parameters = state / 'counters_a.json', logs / 'x.log', tmp_path / 'a.yaml'
    changes, steps = state / 'changes_a.jsonl', tmp_path / 'a.journal.jsonl'
    kept = new, counters, changes, log, parameters, steps
    for path in (old, *kept):
        path.write_text(path.name)
    for path in (old, counters, changes):
        os.utime(path, (0, 0))
    monkeypatch.setenv('ROS_LOG_DIR', str(logs))
    output = tmp_path / 'out.tar.gz'
    assert main([str(parameters), '--folder', str(state), '--output', str(output)]) == 0
    with tarfile.open(output) as archive:
        texts = {name.rpartition('/')[2]: archive.extractfile(name).read().decode()
                 for name in archive.getnames()}
    assert texts.keys() == {
        'versions.txt', 'journal.txt', 'doctor.txt', *(path.name for path in kept)}
    assert all(texts[path.name] == path.name for path in kept)
    assert 'facade_manipulator ' in texts['versions.txt']
    assert all(text in texts['doctor.txt'] for text in ('versions', 'publishers', 'doctor: '))


def test_without_a_folder_it_is_that_of_the_services_and_an_empty_one_is_said(
        tmp_path, monkeypatch, capsys):
    unit, home, mine = tmp_path / 'unit', tmp_path / 'services', tmp_path / 'mine'
    mine.mkdir()
    unit.write_text('[Service]\nUser=box\n')
    monkeypatch.setattr(resources, 'SERVICE_UNIT', unit)
    monkeypatch.setattr(resources, 'STATE_FOLDER', '~/.ros/facade_manipulator')
    monkeypatch.setattr(resources.pwd, 'getpwnam', {'box': SimpleNamespace(pw_dir=home)}.get)
    monkeypatch.setattr(support, '_output', lambda *_: '')
    monkeypatch.setenv('HOME', str(mine))
    monkeypatch.setenv('ROS_LOG_DIR', str(mine))
    folder, output = home / '.ros/facade_manipulator', tmp_path / 'out.tar.gz'
    assert main(['--output', str(output)]) == 0
    said = capsys.readouterr()
    assert f'counters or changes in {folder}; next: --folder' in said.err
    folder.mkdir(parents=True)
    (folder / 'counters_a.json').touch()
    assert main(['--output', str(output)]) == 0
    said = capsys.readouterr()
    assert f'1 files, 0.0 MB, of {folder};' in said.out and not said.err
    assert resources.written_folder('/data') == Path('/data')
    unit.unlink()  # services of the user's own, or none
    assert resources.written_folder('~/.ros') == mine / '.ros'


def test_a_parameter_file_that_is_missing_leaves_no_archive(tmp_path, capsys):
    output = tmp_path / 'out.tar.gz'
    assert main(['missing.yaml', '--folder', str(tmp_path), '--output', str(output)]) == 1
    assert 'missing.yaml' in capsys.readouterr().err and not list(tmp_path.iterdir())


def test_what_a_recorder_deletes_meanwhile_is_no_error(tmp_path, monkeypatch, capsys, ros_domain):
    state, logs = tmp_path / 'state', tmp_path / 'log'
    for folder in (state, logs):
        folder.mkdir()
    pruned, kept = state / 'blackbox_000001_a.mcap', state / 'blackbox_000002_a.mcap'
    for path in (pruned, kept):
        path.touch()

    def prune():
        pruned.unlink()
        return logs

    monkeypatch.setattr('facade_manipulator.tools.support._logs', prune)
    output = tmp_path / 'out.tar.gz'
    assert main(['--folder', str(state), '--output', str(output)]) == 0
    assert f'{output}: 1 files' in capsys.readouterr().out
    with tarfile.open(output) as archive:
        names = {name.rpartition('/')[2] for name in archive.getnames()}
    assert kept.name in names and pruned.name not in names
