"""The guest of the SocketCAN tests, with scripts in the place of its kernel."""

from __future__ import annotations

from pathlib import Path
import sys

import pytest

SOCKETCAN = Path(__file__).parent / 'socketcan'
# what the kernel is told: where the order lies, and which descriptor is the serial line
TOLD = r"""#!/bin/sh
for option; do
  case $option in
    init=*) folder=${option#init=?}; folder=${folder%/init?} ;;
    ssl0=*) line=${option#ssl0=null,fd:} ;;
  esac
done
"""
BANNER = 'echo Linux version 6.1\n'


@pytest.fixture
def guest(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(SOCKETCAN)
    import guest

    monkeypatch.setattr(guest, 'CACHE', tmp_path / 'a cache')
    monkeypatch.setattr(guest, 'MEMORY', 1)
    return guest


@pytest.fixture
def run(guest):
    """Run a command in a guest whose kernel is this script."""
    def run(script: str, timeout: float = 60.0, silence: float = 60.0) -> int:
        kernel = guest.CACHE / 'root' / 'usr' / 'bin' / 'linux.uml'
        kernel.parent.mkdir(parents=True)
        kernel.write_text(TOLD + script)
        kernel.chmod(0o755)
        (guest.CACHE / 'root/usr/lib/uml/modules/6.1').mkdir(parents=True)
        return guest.run_in_guest(['true'], timeout, silence)

    yield run
    assert not list(guest.CACHE.glob('guest_*')), 'a folder is left over'


def test_the_exit_status_and_the_output_come_out_of_the_guest(run, capfd):
    assert run(BANNER + 'echo hello >/proc/self/fd/$line; printf 3 >"$folder/status"') == 3
    assert capfd.readouterr().out == 'hello\n'


def test_the_guest_finds_its_order(run, guest):
    assert run('grep -q \'"command": \\["true"\\]\' "$folder/command.json" && '
               'grep -q guest_init "$folder/init" && printf 0 >"$folder/status"') == 0


def test_a_guest_that_dies_is_an_error_with_its_console(run, guest):
    with pytest.raises(guest.GuestError, match='(?s)died.*exit status 9.*Kernel panic'):
        run(BANNER + 'echo "Kernel panic - not syncing"; exit 9')


def test_a_guest_that_does_not_end_is_stopped(run, guest):
    with pytest.raises(guest.GuestError, match='stopped after 0.5 s'):
        run(BANNER + 'sleep 600', timeout=0.5)


def test_a_guest_that_stands_still_is_stopped_and_told_from_others(run, guest):
    with pytest.raises(guest.GuestSilentError, match='(?s)nothing for 1.5 s.*Linux version'):
        run(BANNER + 'echo hello >/proc/self/fd/$line; sleep 600', silence=1.5)


def test_a_guest_that_talks_may_take_its_time(run):
    talk = 'for i in 1 2 3 4 5 6; do echo $i >/proc/self/fd/$line; sleep 0.5; done; '
    assert run(BANNER + talk + 'printf 0 >"$folder/status"', silence=2.0) == 0


def test_a_guest_that_cannot_run_the_command_says_why(run, guest):
    with pytest.raises(guest.GuestError, match='no such program'):
        run(BANNER + 'echo no such program >"$folder/error"')


def test_a_kernel_that_does_not_start_is_not_available_here(run, guest):
    with pytest.raises(guest.GuestUnavailableError, match='(?s)does not start.*no ptrace'):
        run('echo no ptrace; exit 1')


def test_a_machine_without_apt_has_no_guest(monkeypatch, guest):
    monkeypatch.setattr('shutil.which', lambda tool: None)
    with pytest.raises(guest.GuestUnavailableError, match='apt-get is not on this system'):
        guest.run_in_guest(['true'])


def test_a_machine_with_no_room_has_no_guest(monkeypatch, run, guest):
    monkeypatch.setattr(guest, 'MEMORY', 1 << 60)
    with pytest.raises(guest.GuestUnavailableError, match='takes the 1099511627776 MB'):
        run('exit 0')


def test_the_tests_run_without_a_vcan_and_are_told_why(monkeypatch, guest, capfd):
    import vcan

    def unavailable(*_):
        raise guest.GuestUnavailableError('no such thing')

    monkeypatch.setattr(guest, 'run_in_guest', unavailable)
    monkeypatch.setattr(vcan, 'NAMESPACES', ())
    monkeypatch.setattr(vcan, 'INTERFACE', Path('/nowhere'))
    script = f'import os; print(os.environ["{vcan.MISSING}"])'
    assert vcan.run([sys.executable, '-c', script]) == ('no vcan', 0)
    printed = capfd.readouterr().out
    assert '!!! NO SOCKETCAN TESTS' in printed
    assert printed.rstrip().endswith('user-mode Linux cannot be had: no such thing')
