"""Command `stop-test`: distances of three simulated axes, and drives that do not stop."""

import re

import numpy as np
import pytest

from facade_manipulator.canopen import cob_ids
from facade_manipulator.tools import stopping
from facade_manipulator.tools.commissioning.stop_test import MASTER_SILENCE
from facade_manipulator.tools.commissioning.tool_bus import ToolBus

pytestmark = pytest.mark.long

SLOW = ('stop-test', '--speed', '100')


@pytest.mark.parametrize('coasting', [1.6, 3.0, 6.0, 10.0, 20.0])
def test_stopping_accepts_the_printed_coasting(make_rig, capsys, coasting):
    rig = make_rig('--coasting', str(coasting)).configured()
    assert rig.run('stop-test') == 0
    said = capsys.readouterr().out
    printed = float(re.search(r'--coasting ([\d.]+)', said)[1])
    assert printed == pytest.approx(coasting, rel=0.1 if coasting <= 10.0 else 0.25)
    (command,) = re.findall('next: stopping (.*--coasting.*)', said)
    assert stopping.main(command.split()) == 0


def test_stopping_distances_are_measured_and_recorded(make_rig, capsys):
    rig = make_rig('--coasting', '1.6').configured()
    assert rig.run('stop-test') == 0
    said = capsys.readouterr().out

    def distance(way):
        return float(re.search(rf'q1: {way}, ([\d.]+) of', said)[1])

    quick = distance('quick stop')
    off = distance('power off')
    assert 0.0 < quick < off
    assert 'stop-test' in rig.overlay.steps()
    assert not rig.is_powered


def is_weak(drive) -> None:
    # as for a heavy load
    drive.motor.peak_acceleration = 1.3 * drive.motor.counts_per_metre


def decelerates(share: float):
    """Return a fault of a drive that has a share of the deceleration of 6085h."""

    def spoil(drive) -> None:
        drive.objects.units[0x6085] /= share

    return spoil


def has_a_weak_motor(drive) -> None:
    drive.motor.peak_acceleration = 3.0 * drive.motor.counts_per_metre


@pytest.mark.parametrize(
    'spoil', [decelerates(0.5), decelerates(0.75), has_a_weak_motor]
)
def test_quick_stop_weaker_than_configured_is_rejected(rig, capsys, spoil):
    spoil(rig.drives[0])
    assert rig.run('stop-test') == 1
    said = capsys.readouterr()
    assert '! q1: quick stop decelerates with' in said.err
    assert 'below axes.stop_deceleration = 6 m/s^2; next: check 6085h' in said.err
    assert '! q2:' not in said.err
    assert 'stop-test' not in rig.overlay.steps()


def test_slow_stop_test_is_too_inaccurate_for_the_deceleration(rig, capsys):
    assert rig.run(*SLOW) == 1
    assert 'next: repeat with commission stop-test --speed 300' in (
        capsys.readouterr().err
    )


def ignores_the_master(drive) -> None:
    drive.axis.lose_connection = lambda: None


@pytest.mark.parametrize(
    ('spoil', 'problem'),
    [
        (
            is_weak,
            r'! q1: quick stop stops the carriage after [\d.]+ mm, above the limit '
            r'[\d.]+ mm; next: check 6085h',
        ),
        (
            ignores_the_master,
            r'! q1: silent master does not stop the drive, which is in the state operation '
            r'enabled \(.*\) 1 s after the last heartbeat \(limit 0.15 s\); next: check 1016h',
        ),
    ],
)
def test_drive_that_stops_late_is_named(rig, capsys, spoil, problem):
    spoil(rig.drives[0])
    assert rig.run('stop-test') == 1
    said = capsys.readouterr().err
    assert re.search(problem, said)
    assert '! q2:' not in said
    assert 'stop-test' not in rig.overlay.steps()


def test_silent_master_stops_the_kernel_sync(rig):
    times = []

    def listen(cob_id, _):
        if cob_id == cob_ids.SYNC:
            times.append(rig.clock.now)
        return []

    rig.has_kernel_sync = True
    rig.nodes.append(listen)
    assert rig.run('stop-test') == 0
    # the pauses between the three motions are shorter
    assert max(np.diff(times)) == pytest.approx(MASTER_SILENCE, abs=0.02)


@pytest.mark.parametrize('has_kernel_sync', [False, True])
def test_silent_master_passes_on_a_slow_computer(
    rig, monkeypatch, capsys, has_kernel_sync
):
    # the heartbeats of the silence wait to be read when the first cycle ends
    monkeypatch.setattr('fake_bus.ON_THE_WIRE', 3e-4)
    rig.has_kernel_sync = has_kernel_sync
    rig.run('stop-test')
    assert 'silent master' not in capsys.readouterr().err


def test_drive_without_an_answer_after_the_silence_is_rejected(
    rig, monkeypatch, capsys
):
    monkeypatch.setattr(ToolBus, 'number', lambda *_: None)
    assert rig.run('stop-test') == 1
    said = capsys.readouterr().err
    assert '! q1: silent master: the drive does not answer for its statusword' in said


LATE_CYCLES = (
    r'quick stop: \d+ of \d+ cycles were late or lacked an answer.*; next: end other'
)


def test_late_cycles_of_a_stop_are_reported(rig, monkeypatch, capsys):
    monkeypatch.setattr('fake_bus.ON_THE_WIRE', 1e-3)
    assert rig.run('stop-test') == 0
    assert re.search(LATE_CYCLES, capsys.readouterr().out)


def test_late_cycles_are_first_problem_of_a_failed_stop(rig, monkeypatch, capsys):
    monkeypatch.setattr('fake_bus.ON_THE_WIRE', 1e-3)
    decelerates(0.5)(rig.drives[0])
    assert rig.run('stop-test') == 1
    first = re.search(r'^! (.*)', capsys.readouterr().err, re.MULTILINE)[1]
    assert re.match(LATE_CYCLES, first)


def test_stop_test_asks_only_once(rig):
    assert rig.run('stop-test', yes=False) == 0
    assert len(rig.questions) == 1


def test_carriage_that_never_stops_is_rejected(rig, monkeypatch, rejected):
    monkeypatch.setattr(
        'facade_manipulator.tools.commissioning.stop_test._LONGEST', 0.02
    )
    assert (
        'a carriage still moves after 0.02 s; next: use the emergency stop'
        in rejected(*SLOW)
    )
