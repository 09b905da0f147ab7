"""Sweep of l and b on threads, processes and a cluster."""

from concurrent.futures import ThreadPoolExecutor
import os
from pathlib import Path
import signal

from mechanism import NO_GAP
import numpy as np
import pytest
from support import children, wait_until

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.study import optimum
from facade_manipulator.study.optimum import best, designs, evaluate, executor_of, sweep
from facade_manipulator.study.workspace_metrics import Good

LENGTHS = np.linspace(0.3, 0.4, 200).round(9)
DESIGNS = [(length, 0.35) for length in LENGTHS.tolist()]


def optima(chosen):
    merits = [evaluate(one, NO_GAP, Good()) for one in chosen]
    rows = best(merits, optimum.OBJECTIVES)
    return {(row['designs'], row['objective']): row for row in rows}


@pytest.mark.long
def test_optimum_along_the_sum_is_at_350_mm():
    found = optima([one for one in designs() if 0.325 < one[0] < 0.36])
    for objective, length in (
        ('area', 0.350),
        ('good_area', 0.350),
        ('volume', 0.332),
        ('ratio', 0.349),
    ):
        assert found['all', objective]['link_length'] == length
        assert found['l >= b', objective]['link_length'] == 0.350
        assert found['l >= b', objective]['beyond_share'] == pytest.approx(
            0.0, abs=1e-12
        )
    assert found['all', 'volume']['beyond_share'] > 0.3
    assert found['all', 'ratio']['value'] == pytest.approx(0.986, abs=5e-4)


def test_optimum_without_sum_is_a_corner_of_table_1():
    chosen = designs(0.0, 0.05)
    assert len(chosen) == 36
    row = optima(chosen)['l >= b', 'area']
    assert row['link_length'] == 0.4
    assert row['platform_half_length'] == 0.4


@pytest.mark.realtime
def test_dead_process_ends_the_sweep_with_a_message():
    def kill_one(merits, total):
        os.kill(next(iter(pool._processes)), signal.SIGKILL)
        return merits

    with (
        pytest.raises(ManipulatorError, match='a process that measures designs died'),
        executor_of(None) as pool,
    ):
        sweep(DESIGNS, NO_GAP, Good(), pool, kill_one)


@pytest.mark.realtime
def test_killed_study_ends_its_processes(start_process):
    process = start_process(
        'facade_manipulator.study', '--optimise', 'volume', '--sum', '0'
    )
    wait_until(lambda: children(process.pid), 'the pool', 60.0)
    pool = children(process.pid)
    process.kill()
    wait_until(
        lambda: not any(Path(f'/proc/{pid}').exists() for pid in pool), 'them to end'
    )


@pytest.mark.realtime
def test_sweep_survives_the_loss_of_a_cluster_worker():
    distributed = pytest.importorskip('distributed')
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None
    ) as cluster:

        def kill_one(merits, total):
            for count, merit in enumerate(merits):
                if count == 20:
                    os.kill(cluster.workers[0].pid, signal.SIGKILL)
                yield merit

        with executor_of(cluster.scheduler_address) as executor:
            found = sweep(DESIGNS, NO_GAP, Good(), executor, kill_one)
    with ThreadPoolExecutor(2) as threads:
        assert found == sweep(DESIGNS, NO_GAP, Good(), threads)


@pytest.mark.parametrize('address', ['tcp://127.0.0.1:9', 'nonsense://there'])
def test_silent_scheduler_is_named(monkeypatch, address):
    pytest.importorskip('distributed')
    monkeypatch.setattr(optimum, 'CONNECTION_TIMEOUT', 0.3)
    with (
        pytest.raises(ManipulatorError, match=f'scheduler {address} does not answer'),
        executor_of(address),
    ):
        pass
