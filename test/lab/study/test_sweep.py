"""Volumes of many designs: any executor, a file of results, and what dies on the way."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
import os
from pathlib import Path
import signal

import numpy as np
import pytest
from support import children, wait_until

from facade_manipulator.errors import ManipulatorError, ParameterError
from facade_manipulator.lab.study import sweep
from facade_manipulator.lab.study.optimise import optimise, sweep_size
from facade_manipulator.lab.study.requirements import Requirements
from facade_manipulator.lab.study.sweep import executor_of, measure_designs, Sweep
from facade_manipulator.lab.study.volume import measure

NEED = Requirements(length_sum=0.0, designs=200)
DESIGNS = np.stack([np.linspace(0.3, 0.4, 200), np.full(200, 0.35)])


@pytest.mark.long
def test_fewer_angles_are_as_exact_where_no_locus_bends_the_integrand():
    random = np.random.default_rng(3)
    for half, more, gap in random.uniform((0.3, 0.0, 0.0), (0.4, 0.1, 0.05), (40, 3)):
        need = Requirements(carriage_gap=gap)
        geometry = need.geometry(half + more, half)
        (_, _, *found), = measure_designs([(half + more, half)], need)
        exact = measure(geometry, need.threshold, need.characteristic_length, 2048, 64)
        assert found == pytest.approx(exact, rel=1e-5, abs=1e-9)


def test_what_a_file_has_is_not_measured_again(tmp_path, monkeypatch):
    file, measured = tmp_path / 'results.jsonl', []
    monkeypatch.setattr(sweep, 'measure', lambda *of: measured.append(of) or measure(*of))
    first = Sweep(NEED, path=file).of(DESIGNS[:, :40])
    with file.open('a') as half_written:
        half_written.write('[0.3, 0.35, 0.0')
    assert Sweep(NEED, path=file).of(DESIGNS[:, :50])[:40] == first
    assert len(measured) == 50 and len(file.read_text().splitlines()) == 51
    assert file.read_text().endswith(']\n')


@pytest.mark.parametrize(('content', 'words'), [
    ('{"stroke_length": 1.0', 'no file of results'), ('a,b\n1,2\n', 'no file of re'),
    ('[1, 2]\n', 'no file of results'), ('{}\n', 'other inputs: stroke_length = None, not 1.0'),
    ('HEAD[1, 2]\n', 'no file of results'), ('HEAD[1, 2, "x", 4, 5]\n', 'no file of results')])
def test_a_file_of_something_else_stays_as_it_is(tmp_path, content, words):
    file = tmp_path / 'results.jsonl'
    Sweep(NEED, path=file)
    content = content.replace('HEAD', file.read_text())
    file.write_text(content)
    with pytest.raises(ParameterError, match=words):
        Sweep(NEED, path=file)
    assert file.read_text() == content


def test_the_same_seed_scatters_the_same_designs():
    found, again, other = (optimise('area', Requirements(
        length_sum=0.0, designs=20_000, seed=seed)) for seed in (1, 1, 2))
    assert found == again != other and found.designs == 100 * sweep_size('area', NEED)
    assert found.value == pytest.approx(other.value, rel=5e-3)


@pytest.mark.realtime
def test_a_pool_whose_process_dies_ends_in_a_sentence_and_a_rerun_goes_on(tmp_path):
    file = tmp_path / 'results.jsonl'
    with pytest.raises(ManipulatorError, match='a process that measures designs died'), \
            executor_of(None) as pool:
        def kill_one(count):
            with suppress(ProcessLookupError):  # it is dead already
                if count:
                    os.kill(next(iter(pool._processes)), signal.SIGKILL)

        Sweep(NEED, pool, file).of(DESIGNS, kill_one)
    kept = len(file.read_text().splitlines()) - 1
    assert 0 < kept < 200
    done = []
    with ThreadPoolExecutor(2) as threads:
        assert Sweep(NEED, threads, file).of(DESIGNS, done.append) == Sweep(NEED).of(DESIGNS)
    assert done[0] == kept


@pytest.mark.realtime
def test_a_killed_study_takes_its_processes_with_it(start_process):
    process = start_process('facade_manipulator.lab.study.study', '--optimise', 'volume',
                            '--sum', '0', '--designs', '20000')
    wait_until(lambda: children(process.pid), 'the pool', 60.0)
    pool = children(process.pid)
    process.kill()
    wait_until(lambda: not any(Path(f'/proc/{pid}').exists() for pid in pool), 'them to end')


@pytest.mark.realtime
def test_a_cluster_of_which_one_worker_dies_finds_the_same():
    distributed = pytest.importorskip('distributed')
    with distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        with pytest.raises(ParameterError, match='^objective'), \
                executor_of(cluster.scheduler_address):
            optimise('beauty')
        victims = [cluster.workers[0].pid]
        with executor_of(cluster.scheduler_address) as executor:
            found = Sweep(NEED, executor).of(DESIGNS, lambda count: count and victims and os.kill(
                victims.pop(), signal.SIGKILL))
    assert found == Sweep(NEED).of(DESIGNS) and not victims


@pytest.mark.parametrize('address', ['tcp://127.0.0.1:9', 'nonsense://there'])
def test_a_scheduler_that_does_not_answer_is_named(monkeypatch, address):
    pytest.importorskip('distributed')
    monkeypatch.setattr(sweep, 'CONNECTION_TIMEOUT', 0.3)
    with pytest.raises(ManipulatorError, match=f'scheduler {address}: '), executor_of(address):
        pass
