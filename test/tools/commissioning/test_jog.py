"""Command `jog`: it moves while a key is held, and stops whatever happens."""

from __future__ import annotations

from contextlib import suppress
import os
import threading
import time

import can
from commission_rig import CommissionRig
import pytest
from support import wait_until
import yaml

from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.states import POWERED_STATES
from facade_manipulator.errors import CommissioningError
from facade_manipulator.resources import config_path
from facade_manipulator.tools.commissioning.machine import Machine
from facade_manipulator.tools.commissioning.motion import MAX_SPEED, Motion, Ramp

STOP_TIME = 0.16
MOVED = 0.002  # m


@pytest.fixture
def rig(make_rig):
    return make_rig().configured()


class Hand:
    """Somebody who holds a key: a thread that repeats it into a pipe that is the terminal."""

    def __init__(self, monkeypatch) -> None:
        self.read, self.write = os.pipe()
        self.key = None
        self.released = 0.0
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._repeat)
        monkeypatch.setattr('sys.stdin', os.fdopen(self.read, 'rb', closefd=False))
        self._thread.start()

    def _repeat(self) -> None:
        while not self._done.wait(0.03):
            if self.key:
                os.write(self.write, self.key)

    def let_go(self) -> None:
        self.key = None
        self.released = time.monotonic()

    def close(self) -> None:
        self._done.set()
        self._thread.join()
        for descriptor in (self.read, self.write):
            with suppress(OSError):
                os.close(descriptor)


@pytest.fixture
def hand(monkeypatch):
    made = Hand(monkeypatch)
    yield made
    made.close()


def carriage(rig: CommissionRig, number: int = 0) -> float:
    with rig.simulator.access() as drives:
        return drives[number].motor.carriage_position


def speed(rig: CommissionRig, number: int = 0) -> float:
    with rig.simulator.access() as drives:
        motor = drives[number].motor
        return abs(motor.velocity) / motor._per_metre


def until_moving(rig, number=0):
    start = carriage(rig, number)
    wait_until(lambda: abs(carriage(rig, number) - start) > MOVED, 'motion')


def stop_time(rig, since, number=0):
    wait_until(lambda: speed(rig, number) < 1e-4, 'rest', 2.0)
    return time.monotonic() - since


def jogging(rig, hand, script, *options):
    """Run `jog q1` in this thread while a script runs in another; return the exit status."""
    failures = []

    def run():
        try:
            script()
        except BaseException as error:
            failures.append(error)
        finally:
            hand.key = None
            with suppress(OSError):
                os.write(hand.write, b'q')

    thread = threading.Thread(target=run)
    thread.start()
    status = rig.run('jog', 'q1', '--links', 'uncoupled', *options)
    thread.join()
    if failures:
        raise failures[0]
    return status


@pytest.mark.parametrize(('key', 'sign', 'raw'), [
    (b'd', 1, 0.0), (b'a', -1, 12.0), (b'\x1b[D', -1, -12.0)])
def test_a_carriage_moves_alone_while_the_key_is_held_and_stops_when_it_is_let_go(
        rig, hand, capsys, key, sign, raw):
    with rig.simulator.access() as drives:  # an encoder of many turns, at `raw` when it came
        drives[0].motor.count_from_here = lambda: None
        drives[0].motor.offset += AxisSettings().to_counts(raw)
    starts = [carriage(rig, number) for number in range(3)]

    def script():
        hand.key = key
        until_moving(rig)
        hand.let_go()
        assert stop_time(rig, hand.released) < STOP_TIME

    assert jogging(rig, hand, script) == 0
    assert sign * (carriage(rig, 0) - starts[0]) > MOVED
    assert [carriage(rig, 1), carriage(rig, 2)] == starts[1:]
    assert rig.drives[0].state not in POWERED_STATES
    assert 'power: confirmed off' in capsys.readouterr().out


def test_a_closed_terminal_stops_it(rig, hand):
    def script():
        hand.key = b'd'
        until_moving(rig)
        hand.key = None
        closed = time.monotonic()
        os.close(hand.write)
        assert stop_time(rig, closed) < STOP_TIME

    assert jogging(rig, hand, script) == 0


def test_coupled_links_move_all_three_alike(rig, hand):
    starts = [carriage(rig, number) for number in range(3)]

    def script():
        hand.key = b'd'
        until_moving(rig)
        hand.let_go()
        wait_until(lambda: speed(rig) < 1e-4, 'rest')

    assert jogging(rig, hand, script, '--links', 'coupled') == 0
    moved = [carriage(rig, number) - start for number, start in enumerate(starts)]
    assert moved[0] > MOVED
    assert max(moved) - min(moved) < 1e-4


def test_the_window_ends_the_motion_gently(rig, hand):
    start = carriage(rig)

    def script():
        hand.key = b'd'
        wait_until(lambda: carriage(rig) - start > 0.0045, 'the end of the window')
        wait_until(lambda: speed(rig) < 1e-4, 'rest at the end')
        hand.let_go()

    assert jogging(rig, hand, script, '--window', '5', '--speed', '20') == 0
    assert carriage(rig) - start <= 0.0051


def test_a_drive_that_falls_silent_stops_the_jog_with_its_name(rig, hand, rejected):
    def script():
        hand.key = b'd'
        until_moving(rig)
        rig.drives[0].is_silent = True
        wait_until(lambda: speed(rig) < 1e-4, 'a stop')

    assert 'q1 sent nothing for 5 cycles' in rejected(jogging, rig, hand, script)
    wait_until(lambda: speed(rig) < 1e-4, 'rest')


@pytest.mark.parametrize(('code', 'message'), [
    (0x2310, 'current is too high (error code 2310h); next: remove the cause; the carriages'),
    (0x8611, 'error is beyond its window (error code 8611h); the carriages are stopped')])
def test_a_fault_of_one_drive_stops_all_with_what_it_is(rig, hand, rejected, code, message):
    def script():
        hand.key = b'd'
        until_moving(rig)
        with rig.simulator.access() as drives:
            drives[1].inject_fault(code)
        wait_until(lambda: speed(rig) < 1e-4, 'a stop')

    assert message in rejected(jogging, rig, hand, script, '--links', 'coupled')
    wait_until(lambda: max(speed(rig, n) for n in range(3)) < 1e-4, 'rest')
    assert not {drive.state for drive in rig.drives} & POWERED_STATES


@pytest.mark.parametrize(('cob_id', 'data', 'message'), [
    (0x701, bytes(1), 'q1 has restarted'), (0x81, b'\x10\x23' + bytes(6), 'motor current is too'),
    (0x77F, b'\x05', 'another master is on the bus')])
def test_what_a_drive_or_another_master_says_stops_the_jog_before_its_state_does(
        rig, hand, rejected, cob_id, data, message):
    def script():
        hand.key = b'd'
        until_moving(rig)
        with can.Bus(interface='virtual', channel=rig.channel, ignore_config=True) as other:
            other.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))
            wait_until(lambda: speed(rig) < 1e-4, 'a stop')

    assert message in rejected(jogging, rig, hand, script)


def test_a_drive_that_does_not_become_operational_is_not_powered(rig, hand, capsys, monkeypatch):
    monkeypatch.setattr(rig.drives[0].objects.nmt, 'on_command', lambda *_: None)
    assert rig.run('jog', 'q1', '--links', 'uncoupled') == 1
    assert 'node 1 did not confirm by its heartbeat' in capsys.readouterr().err


def profile_with(folder, **changes):
    data = yaml.safe_load(config_path('drives/simulated.yaml').read_text()) | changes
    path = folder / 'other.yaml'
    path.write_text(yaml.safe_dump(data | {'eds': str(config_path('drives/cia402.eds'))}))
    return str(path)


def test_what_the_profile_excuses_or_calls_a_warning_stops_no_jog(
        make_rig, hand, tmp_path, capsys):
    warm = {'message': 'it is warm', 'remedy': 'let it cool', 'is_warning': True}
    profile = profile_with(tmp_path, quirks={'never_follows': True}, errors={0x43F0: warm})
    rig = make_rig('--profile', profile).configured(profile=profile)

    def script():
        hand.key = b'd'
        until_moving(rig)
        with can.Bus(interface='virtual', channel=rig.channel, ignore_config=True) as other:
            other.send(can.Message(
                arbitration_id=0x81, data=b'\xF0\x43' + bytes(6), is_extended_id=False))
        until_moving(rig)

    assert jogging(rig, hand, script) == 0
    assert '! q1: it warns: it is warm (error code 43F0h): let it cool' in capsys.readouterr().out


@pytest.mark.parametrize('given_up', [False, True])
def test_a_drive_that_would_outlive_this_computer_moves_only_where_that_is_given_up(
        rig, hand, capsys, given_up):
    objects = yaml.safe_load(config_path('drives/simulated.yaml').read_text())['objects']
    rig.configured(profile=profile_with(
        rig.folder, objects=[one for one in objects if one['index'] != 0x1016]))
    Machine(rig.parameters).write({'controller': {'give_up_dead_master_stop': given_up}})
    os.write(hand.write, b'q')
    assert rig.run('jog', 'q1', '--links', 'uncoupled') == (0 if given_up else 1)
    said = capsys.readouterr().err
    assert given_up or 'moving is not possible: q1 would move on' in said
    assert rig.drives[0].state not in POWERED_STATES


@pytest.mark.parametrize(('displacement', 'message'), [
    (0.01, 'a step of 10.00 mm in a cycle'), (0.06, 'outside the window of 50 mm'),
    (float('nan'), 'outside the window of 50 mm')])
def test_no_target_is_far_away_or_outside_the_window(displacement, message):
    motion = Motion(None, {'q1': AxisSettings()}, 'q1', 0.05)
    with pytest.raises(CommissioningError, match=message):
        motion.step(displacement)


@pytest.mark.parametrize('options', [('--speed', '51'), ('--speed', '0'), ('--window', '201'),
                                     ('--speed', 'nan')])
def test_bounds_are_kept(rig, hand, capsys, options):
    assert rig.run('jog', 'q1', '--links', 'uncoupled', *options) == 1
    assert 'is not between 0 and' in capsys.readouterr().err


def test_whether_the_links_are_coupled_must_be_said(rig, hand, rejected):
    assert '--links' in rejected(rig.run, 'jog', 'q1')


def test_a_ramp_stays_in_its_window_and_below_its_acceleration():
    ramp, before, last = Ramp(0.01), 0.0, 0.0
    for goal in [MAX_SPEED] * 100 + [-MAX_SPEED] * 200 + [0.0] * 50:
        here = ramp.step(goal)
        assert abs(here) <= 0.01
        assert abs((here - last) - (last - before)) <= 1.05e-4
        before, last = last, here
    assert ramp.speed == pytest.approx(0.0, abs=1e-9)
