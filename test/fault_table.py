"""
The fault table of the drives, proved row by row in every situation, with its reaction times.

``python test/fault_table.py --repeat 5`` prints them, and what happens where the node or the loop
ends, hangs or sends nonsense; `test_fault_matrix` and `test_channel_faults` run each case once.
With ``--interface socketcan --channel vcan0``, as root of a network namespace or as
``python test/socketcan/vcan.py -- python test/fault_table.py …``, the bus is the kernel's.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
import math
from operator import and_
from pathlib import Path
import statistics
import sys
import time

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), *(str(HERE / name) for name in ('helpers', 'socketcan'))]

import can  # noqa: E402
import channel_faults  # noqa: E402
from channel_faults import Reaction  # noqa: E402
from drive_rig import PATIENCE  # noqa: E402
from fault_rig import enables, EXACT, OneRig, SITUATIONS, Spoil, StreamRig  # noqa: E402
from frames import decode_rpdo1  # noqa: E402
import link  # noqa: E402
import pytest  # noqa: E402
from support import patiently, wait_until  # noqa: E402

from facade_manipulator.drives.canopen import pdo  # noqa: E402
from facade_manipulator.drives.cia402.settings import AXIS_NAMES  # noqa: E402
from facade_manipulator.drives.cia402.states import Controlword, Mode, Power, State  # noqa: E402
from facade_manipulator.drives.controller.snapshot import ControllerState  # noqa: E402
from facade_manipulator.motion.follower import Activity  # noqa: E402
from facade_manipulator.simulation.drives.drive import SimulatedDrive  # noqa: E402

NODES = (1, 2, 3)
VICTIM = 1  # q2
ROUNDING = 1e-5  # m
TRIES = 4
POWERLESS = {State.SWITCH_ON_DISABLED, State.FAULT, State.NOT_READY_TO_SWITCH_ON}


# --- what happens

def _victim(act: Callable[[SimulatedDrive], object]) -> Callable[[StreamRig], None]:
    def inject(rig: StreamRig) -> None:
        with rig.simulator.access() as drives:
            act(drives[VICTIM])
    return inject


def _emergency(code: int) -> Callable[[StreamRig], None]:
    return _victim(lambda drive: drive.inject_fault(code))


def _silence(drive: SimulatedDrive) -> None:
    drive.is_silent = True


def _receive_no_rpdo(rig: StreamRig) -> None:
    with rig.simulator.access() as drives:
        _patch(rig, drives[VICTIM]._pdo, receives=lambda cob_id: False)


def _ignore_targets(rig: StreamRig) -> None:
    with rig.simulator.access() as drives:
        mode = drives[VICTIM].axis.modes[Mode.CYCLIC_SYNCHRONOUS_POSITION]
        _patch(rig, mode, latch=lambda: None, status=lambda: 0)


def _patch(rig: StreamRig, thing: object, **methods: Callable) -> None:
    vars(thing).update(methods)
    rig.repairs.append(lambda: [vars(thing).pop(name) for name in methods])


def _bus_off(rig: StreamRig) -> None:
    rig.bus_is_missing = True
    rig.listener.send(can.Message(
        arbitration_id=0x040, data=bytes(8), is_error_frame=True, is_extended_id=False))


def _link_down(rig: StreamRig) -> None:
    rig.bus_is_missing = True
    rig.buses[-1].shutdown()


def _congest(rig: StreamRig) -> None:
    def full(message, timeout=None):
        raise can.CanOperationError('Transmit buffer full')

    rig.bus_is_missing = True
    rig.buses[-1].send = full


def _interface_down(rig: StreamRig) -> None:
    with _permission():
        link.clear_flags(rig.channel, link.IFF_UP)
    rig.repairs.append(lambda: link.set_flags(rig.channel, link.IFF_UP))
    rig.overhear()


def _interface_congested(rig: StreamRig) -> None:
    with _permission():
        link.plug(rig.channel)
    rig.repairs.append(lambda: link.unplug(rig.channel))
    rig.overhear()


@contextmanager
def _permission() -> Iterator[None]:
    """Skip what this user or this kernel does not do to an interface."""
    try:
        yield
    except OSError as error:
        pytest.skip(str(error))


def repair(rig: StreamRig) -> None:
    """Remove every cause that a row may have left."""
    rig.repair()
    rig.bus_is_missing = False
    with rig.simulator.access() as drives:
        for drive in drives:
            drive.is_silent = False
            drive.remove_cause()


# --- how to go on: nothing of it gives power

def _clear(rig: StreamRig) -> None:
    answer = rig.clear()
    following = 'next: home, activate' if rig.is_homing_rig else 'next: activate'
    assert following in answer, answer


def _clear_and_home(rig: StreamRig) -> None:
    assert rig.controller.snapshot().unhomed == (AXIS_NAMES if rig.is_homing_rig else ('q2',))
    assert 'next: home, activate' in rig.clear()
    assert 'homed' in rig.rejection('activate')
    if not rig.is_homing_rig:
        rig.do('home')


def _configure_again(rig: StreamRig) -> None:
    assert 'cleanup, configure, home, activate' in rig.rejection('clear_faults')
    rig.do('cleanup')
    rig.configure()


def _configure_and_home_again(rig: StreamRig) -> None:
    assert 'q2' in rig.controller.snapshot().unhomed
    _configure_again(rig)


def _wait_for_the_bus(rig: StreamRig) -> None:
    rig.until(ControllerState.STOPPED)
    _clear(rig)


def _wait_for_the_bus_and_home(rig: StreamRig) -> None:
    """No drive was heard meanwhile: each may have restarted."""
    rig.until(ControllerState.STOPPED)
    assert 'home' in rig.clear()
    if not rig.is_homing_rig:
        rig.do('home')


# --- when all three were stopped

def _commanded(frames: list[can.Message], node: int) -> float | None:
    """Return when a drive was first commanded to stop, None if it was not."""
    return next((
        frame.timestamp for frame in frames if frame.arbitration_id == pdo.RPDO1.cob_id(node)
        and decode_rpdo1(bytes(frame.data)).controlword == Controlword.QUICK_STOP), None)


def _by_itself(frames: list[can.Message], node: int) -> float | None:
    """Return when a drive said that it misses the master's heartbeat, None if it did not."""
    return next((frame.timestamp for frame in frames
                 if frame.arbitration_id == pdo.emergency_cob_id(node)), None)


def _commanded_or_restarted(frames: list[can.Message], node: int) -> float | None:
    """Return when a drive was commanded to stop; the one that restarted gets nothing."""
    return 0.0 if node == VICTIM + 1 else _commanded(frames, node)


@dataclass(frozen=True)
class Row:
    """
    One row of the fault table: what happens, what it does, how to go on.

    `cycles` is how many SYNCs may pass before all are commanded to stop; None for as many as a
    drive may miss. `reply` is the answer to a request under way, where the stop comes before the
    message is complete.
    """

    inject: Callable[[StreamRig], None]
    message: str
    next_step: str = 'clear_faults'
    recover: Callable[[StreamRig], None] = _clear
    cuts_power: bool = False
    cycles: float | None = 3
    stopped: Callable[[list[can.Message], int], float | None] = _commanded
    axis: str = 'q2 (node 2)'
    reply: str = ''


def _lost(inject: Callable[[StreamRig], None], message: str) -> Row:
    return Row(inject, message, 'home', _clear_and_home, cuts_power=True)


def _node(
    inject: Callable[[StreamRig], None], message: str, cycles: float | None = None,
    next_step: str = 'cleanup, configure', **details,
) -> Row:
    return Row(inject, message, next_step, cycles=cycles,
               **{'recover': _configure_again, **details})


def _bus(
    inject: Callable[[StreamRig], None], message: str,
    recover: Callable[[StreamRig], None] = _wait_for_the_bus,
) -> Row:
    return Row(inject, message, 'wait until it is back', recover, cycles=math.inf,
               stopped=_by_itself, axis='')


ROWS = {
    'following error 8611': Row(_emergency(0x8611), 'following error'),
    'limit switch 8A81': Row(_emergency(0x8A81), 'positive limit switch'),
    'position limit 8A82': Row(_emergency(0x8A82), 'software position limit'),
    'communication 8120': Row(_emergency(0x8120), 'error passive', 'check wiring'),
    'short PDO 8210': Row(_emergency(0x8210), 'wrong length', 'check wiring'),
    'position lost 7380': _lost(_victim(SimulatedDrive.lose_position), 'position is lost'),
    'encoder reversed 7392': _lost(_emergency(0x7392), 'counts against the motor'),
    'drive watchdog FF02': _lost(_emergency(0xFF02), 'watchdog of the drive'),
    'overcurrent 2310': Row(_emergency(0x2310), 'current is too high', 'remove the cause'),
    'overvoltage 3210': Row(_emergency(0x3210), 'voltage is too high', 'remove the cause'),
    'undervoltage 3220': Row(_emergency(0x3220), 'voltage is too low', 'remove the cause'),
    'too hot 4210': Row(_emergency(0x4210), 'too hot', 'remove the cause'),
    'encoder 7305': _lost(_emergency(0x7305), 'position is lost'),
    'sensor 7320': _lost(_emergency(0x7320), 'position is lost'),
    'safe torque off 8A88': Row(
        _victim(SimulatedDrive.open_safe_torque_off), 'safe torque off is open',
        'remove the cause'),
    'unknown code B123': Row(_emergency(0xB123), 'in no table', 'remove the cause'),
    'TPDO missing': _node(_victim(_silence), 'did not answer'),
    'heartbeat missing': _node(
        _victim(SimulatedDrive.stop_heartbeat), 'sent no heartbeat', math.inf),
    'unexpected boot-up': _node(
        _victim(SimulatedDrive.reboot), 'has restarted by itself',
        next_step='cleanup, configure, home', reply='q2 (node 2)',
        recover=_configure_and_home_again,
        stopped=_commanded_or_restarted),
    'bus-off': _bus(_bus_off, 'bus-off'),
    'link down': _bus(_link_down, ''),
    'ENOBUFS': _bus(_congest, 'send queue is full'),
}

# drives that lie, which shows once the carriages move
LIES = {
    'no RPDO received any more': _node(
        _receive_no_rpdo, 'behind its targets by its positions', math.inf),
    'targets ignored, bit 12': Row(
        _ignore_targets, 'does not follow its targets, bit 12 is 0', axis='q2'),
}

# what an interface of the kernel's can meet in earnest; bus-off is an error frame on either bus
REAL = {
    'link down': _bus(_interface_down, 'down'),
    'ENOBUFS': _bus(_interface_congested, 'send queue is full', _wait_for_the_bus_and_home),
}


def prove(rig: StreamRig, name: str, situation: str) -> float | None:
    """
    Let something happen in a situation and check everything that the fault table says of it.

    Returns the reaction time [s]: until all three were commanded to stop; without a bus, until
    they said that they stop by themselves; for setpoints, until the targets slow down, and None
    where they moved nothing.
    """
    rig.get_ready()
    SITUATIONS[situation](rig)
    if name in SETPOINTS:
        return _prove_setpoint(rig, SETPOINTS[name], situation)
    row = (REAL if rig.interface == 'socketcan' and name in REAL else {**ROWS, **LIES})[name]
    rig.frames()
    rig.received.clear()
    begin = time.time()
    row.inject(rig)
    rig.until(ControllerState.STOPPED, ControllerState.BUS_LOST)
    wait_until(lambda: State.OPERATION_ENABLED not in rig.drive_states, 'all three to stop')
    if row.cuts_power:
        wait_until(lambda: set(rig.drive_states) <= POWERLESS, 'all three without power')
    seconds = wait_until(lambda: _measured(rig, row, begin), 'the reaction on the bus')
    most = rig.settings.max_missed_cycles if row.cycles is None else row.cycles
    assert _syncs_to_the_last_enabling(rig.received, begin) <= most
    _check_cause(rig, row)
    _check_power(rig)
    if situation == 'homing':
        assert (row.reply or row.message) in str(rig.homing.exception(PATIENCE))
        assert rig.controller.snapshot().unhomed == AXIS_NAMES
    assert rig.rejection('activate')
    rig.fall_silent()
    repair(rig)
    row.recover(rig)
    wait_until(lambda: rig.drive_states == [State.SWITCH_ON_DISABLED] * 3, 'power off')
    assert rig.state is ControllerState.INACTIVE
    assert rig.controller.snapshot().cause == ''
    wait_until(lambda: rig.controller.snapshot().power == Power.CONFIRMED_OFF.value,
               'the power to be confirmed off')
    return seconds


def _check_power(rig: StreamRig) -> None:
    """People reach in on this word: it may be late, never early."""
    confirmed = [axis.power is Power.CONFIRMED_OFF for axis in rig.controller.snapshot().axes]
    with_power = [state not in POWERLESS for state in rig.drive_states]
    assert not any(map(and_, confirmed, with_power))


def _measured(rig: StreamRig, row: Row, begin: float) -> float | None:
    rig.listen()
    frames = [frame for frame in rig.received if frame.timestamp >= begin]
    times = [row.stopped(frames, node) for node in NODES]
    return None if None in times else max(times) - begin


def _check_cause(rig: StreamRig, row: Row) -> None:
    wait_until(lambda: row.message in rig.controller.snapshot().cause,
               f'the cause to say: {row.message}', 2.0)
    snapshot = rig.controller.snapshot()
    assert row.axis in snapshot.cause
    assert row.next_step in snapshot.next_step
    if snapshot.state is ControllerState.BUS_LOST:
        assert snapshot.bus_error and rig.rejection('clear_faults')


def _syncs_to_the_last_enabling(frames: list[can.Message], begin: float) -> int:
    syncs = most = 0
    for frame in frames:
        syncs += frame.arbitration_id == pdo.SYNC_COB_ID and frame.timestamp >= begin
        most = syncs if enables(frame) else most
    return most


# --- setpoints: they never stop the group, the carriages slow down and hold

SETPOINTS: dict[str, Spoil] = {
    'setpoints: silence': lambda setpoint: None,
    'setpoints: stale': lambda setpoint: setpoint._replace(time=setpoint.time - 1.0),
    'setpoints: rejected': lambda setpoint: setpoint._replace(position=(0.0, 0.4, 0.1)),
}


def _prove_setpoint(rig: StreamRig, spoil: Spoil, situation: str) -> float | None:
    begin, before, state = time.time(), rig.carriages, rig.state
    seconds = None
    if situation == 'moving':
        rig.spoil = spoil
        wait_until(lambda: rig.follower.activity in (Activity.BRAKING, Activity.HOLDING),
                   'the targets to slow down', step=lambda: time.sleep(0.001))
        seconds = time.time() - begin
        wait_until(lambda: rig.follower.at_rest, 'the targets to come to rest')
    else:
        rig.stream(spoil)
        rig.cycles(5)
        moved = max(abs(a - b) for a, b in zip(rig.carriages, before, strict=True))
        assert situation == 'homing' or moved < ROUNDING
    assert rig.state is state
    if state is ControllerState.ACTIVE:
        rig.stream()
        wait_until(lambda: rig.follower.activity is Activity.FOLLOWING, 'the stream to go on')
        rig.fall_silent()
        rig.do('deactivate')
    elif situation == 'homing':
        rig.fall_silent()
        rig.do('halt')
    rig.fall_silent()
    return seconds


# --- the whole table

def cases() -> list[tuple[str, str]]:
    """Return row and situation, those that share a rig in a row."""
    return [(name, situation) for situation in SITUATIONS
            for name in (*ROWS, *SETPOINTS, *(LIES if situation == 'moving' else ()))]


def measure(repeat: int, **bus: str) -> dict[tuple[str, str], list[float]]:
    """Prove each case a number of times and return the reaction times [s]."""
    results: dict[tuple[str, str], list[float]] = {case: [] for case in cases()}
    rig = OneRig(EXACT, **bus)
    try:
        for name, situation in results:
            results[name, situation] += _times(rig, name, situation, repeat)
    finally:
        rig.close()
    return results


def _times(rig: OneRig, name: str, situation: str, repeat: int) -> list[float]:
    try:
        times = [prove_patiently(rig, name, situation) for _ in range(repeat)]
    except pytest.skip.Exception as reason:
        print(f'{name}, {situation}: {reason}', file=sys.stderr)
        return []
    return [seconds for seconds in times if seconds is not None]


def prove_patiently(rig: OneRig, name: str, situation: str, tries: int = TRIES) -> float | None:
    """Prove again with a new rig: where bounds are narrow, a busy computer is a fault."""
    def once() -> float | None:
        try:
            return prove(rig.get(situation), name, situation)
        except BaseException:
            rig.close()
            raise
    return patiently(once, tries=tries)


def table(results: dict[tuple[str, str], list[float]]) -> str:
    """Return the reaction times as text: p50 / max [ms]."""
    lines = ['| reaction p50/max [ms] | ' + ' | '.join(SITUATIONS) + ' |',
             '|---|' + '---|' * len(SITUATIONS)]
    for name in (*ROWS, *SETPOINTS, *LIES):
        cells = (_cell(results.get((name, situation), [])) for situation in SITUATIONS)
        lines.append(f'| {name} | ' + ' | '.join(cells) + ' |')
    return '\n'.join(lines)


def channel_table(reactions: dict[str, list[Reaction]]) -> str:
    """Return what happened between node and loop as a table in Markdown."""
    lines = ['| what happens | slower after [ms] | at rest after [ms] | a gap changed by [mm] |',
             '|---|---|---|---|']
    for name, found in reactions.items():
        times = ([each for one in found if (each := getattr(one, what)) is not None]
                 for what in ('slower', 'at_rest'))
        cells = [*map(_cell, times), _cell([one.gap_change for one in found])]
        lines.append(f'| {name} | ' + ' | '.join(cells) + ' |')
    return '\n'.join(lines)


def _cell(times: list[float]) -> str:
    if not times:
        return '–'
    return f'{1e3 * statistics.median(times):.1f} / {1e3 * max(times):.1f}'


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--repeat', type=int, default=5, help='how often each case is proved')
    parser.add_argument('--node-only', action='store_true', help='what happens to the node alone')
    parser.add_argument('--interface', default='virtual', help='of python-can')
    parser.add_argument('--channel', default='faults', help='such as vcan0')
    options = parser.parse_args()
    print(channel_table(channel_faults.measure(options.repeat)))
    if not options.node_only:
        print(table(measure(
            options.repeat, interface=options.interface, channel=options.channel)))
    return 0


if __name__ == '__main__':
    sys.exit(main())
