"""Command `stop-test`: the ways of three simulated axes, and drives that do not stop."""

from __future__ import annotations

import re

import numpy as np
import pytest

from facade_manipulator.tools.commissioning.motion import Motion, PERIOD, StopWay
from facade_manipulator.tools.commissioning.stop_test import allowed, deceleration


def distances(said: str) -> dict[str, list[float]]:
    """Return the distance of each axis [mm] by the way of stopping, from the printed table."""
    return {way: [float(one) for one in re.findall(r'([\d.]+) mm of', row)] for way, row in
            re.findall(r'(quick stop|silent master|power off)([^\n]* mm of [^\n]*)', said)}


def test_stopping_distances_are_measured_and_printed(make_rig, capsys):
    rig = make_rig('--coasting', '1.2').configured()
    assert rig.run('stop-test') == 0
    said = capsys.readouterr().out
    coasting = float(re.search(r'--coasting ([\d.]+)', said)[1])
    assert coasting == pytest.approx(1.2, rel=0.1)
    found = distances(said)
    for quick, silent, off in zip(*found.values(), strict=True):
        assert 0.0 < quick < off and 0.0 < silent < off
    assert list(map(len, found.values())) == [3, 3, 3] and 'NO' not in said
    assert not any(rig.is_enabled(number) for number in range(3))


def is_weak(drive) -> None:
    drive.motor.peak_acceleration = 1.3 * drive.motor._per_metre  # as for a heavy load


def ignores_the_master(drive) -> None:
    drive.axis.lose_connection = lambda: None


@pytest.mark.parametrize(('spoil', 'problem'), [
    (is_weak, 'q1: quick stop took .* look at 6085h'),
    (ignores_the_master, 'q1: would still follow targets after a silent master: look at 1016h')])
def test_drive_that_stops_late_is_named(make_rig, capsys, spoil, problem):
    rig = make_rig().configured()
    spoil(rig.drives[0])
    assert rig.run('stop-test') == 1
    said = capsys.readouterr().out
    assert re.search(problem, said) and '! q2:' not in said


def test_a_speed_that_needs_more_room_moves_nothing(make_rig, rejected):
    rig = make_rig().configured()
    assert '--window 40 mm is less than the' in rejected(rig.run, 'stop-test', '--window', '40')
    assert not any(rig.moves(number) for number in range(3))


def test_who_does_not_agree_powers_nothing(make_rig, rejected, monkeypatch):
    rig = make_rig().configured()
    monkeypatch.setattr('builtins.input', lambda *_: 'n')
    assert 'the answer was not yes' in rejected(rig.run, 'stop-test', yes=False)
    assert not any(rig.is_enabled(number) for number in range(3))


def test_ctrl_c_in_the_middle_takes_the_power(make_rig, capsys, monkeypatch):
    rig = make_rig().configured()

    def interrupted(*_):
        assert rig.moves()
        raise KeyboardInterrupt

    monkeypatch.setattr(Motion, 'stop_by', interrupted)
    assert rig.run('stop-test') == 130
    assert not any(rig.is_enabled(number) for number in range(3)) and not rig.moves()


@pytest.mark.parametrize('way', StopWay)
def test_what_is_allowed_grows_with_speed_and_lag(way):
    assert allowed(way, 0.1, 0.01, 7.0) < allowed(way, 0.2, 0.01, 7.0)
    assert allowed(way, 0.2, 0.01, 7.0) < allowed(way, 0.2, 0.03, 7.0)
    assert allowed(StopWay.SILENCE, 0.2, 0.01, 7.0) > allowed(StopWay.QUICK_STOP, 0.2, 0.01, 7.0)


@pytest.mark.parametrize('coasting', [0.5, 1.9, 3.0])
def test_the_deceleration_of_a_known_way_comes_back(coasting):
    time = np.minimum(PERIOD * np.arange(100), 0.2 / coasting)
    found = deceleration((0.2 * time - 0.5 * coasting * time**2)[:, None])
    assert found == pytest.approx([coasting], rel=0.05)


def test_a_carriage_that_never_stands_is_an_error(make_rig, monkeypatch, rejected):
    rig = make_rig().configured()
    monkeypatch.setattr('facade_manipulator.tools.commissioning.stop_test._LONGEST', 0.02)
    assert 'not all stand; use the emergency stop' in rejected(rig.run, 'stop-test')
