"""The guest of the SocketCAN tests, with shell scripts instead of its kernel."""

from __future__ import annotations

from pathlib import Path
import sys

import pytest

VCAN = Path(__file__).parents[1] / '.ci/vcan'
# The kernel gets the folder of the order and the descriptor of the serial line.
TOLD = r"""#!/bin/sh
for option; do
  case $option in
    init=*) folder=${option#init=?}; folder=${folder%/init?} ;;
    ssl0=*) line=${option#ssl0=null,fd:} ;;
  esac
done
"""
BANNER = 'echo Linux version 7.2.7 and more\n'
FIRST_WORD = BANNER + 'touch "$folder/alive"\n'


@pytest.fixture
def guest(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(VCAN)
    import guest

    monkeypatch.setattr(guest, 'CACHE', tmp_path / 'a cache')
    monkeypatch.setattr(guest, 'MEMORY', 1)
    monkeypatch.delenv('CI', raising=False)
    return guest


@pytest.fixture
def use_kernel(monkeypatch, guest):
    """Let a script be the guest's kernel."""
    def use(script: str) -> None:
        kernel = guest.CACHE / 'root' / 'usr' / 'bin' / 'linux.uml'
        kernel.parent.mkdir(parents=True)
        kernel.write_text(TOLD + script)
        kernel.chmod(0o755)
        monkeypatch.setattr(guest.fetch, 'fetch', lambda folder: folder / 'root')

    yield use
    assert not list(guest.CACHE.glob('guest_*')), 'a folder is left over'


@pytest.fixture
def run(guest, use_kernel):
    """Run a command in a guest whose kernel is this script."""
    def run(script: str, silence: float = 60.0) -> tuple[str, int]:
        use_kernel(script)
        return guest.run_in_guest(['true'], silence)
    return run


@pytest.fixture
def run_tests(monkeypatch, use_kernel):
    """Run a command that says why there is no vcan, where only this kernel could have one."""
    def run(script: str) -> tuple[str, int]:
        import vcan

        use_kernel(script)
        monkeypatch.setattr(vcan, 'NAMESPACES', ())
        monkeypatch.setattr(vcan, 'INTERFACE', Path('/nowhere'))
        return vcan.run([sys.executable, '-c', f'import os; print(os.environ["{vcan.MISSING}"])'])
    return run


def test_guest_returns_exit_status_and_output(run, capfd):
    assert run(
        FIRST_WORD + 'echo hello >/proc/self/fd/$line; printf 3 >"$folder/status"') == ('7.2.7', 3)
    assert capfd.readouterr().out == 'hello\n'


def test_guest_that_dies_raises_with_its_console(run, guest):
    with pytest.raises(guest.GuestError, match='(?s)died.*exit status 9.*Kernel panic'):
        run(FIRST_WORD + 'echo "Kernel panic - not syncing"; exit 9')


def test_guest_that_dies_at_boot_is_unavailable(run, guest):
    with pytest.raises(guest.GuestUnavailableError, match='(?s)not start.*status 134.*fatal_sig'):
        run(BANNER + 'echo fatal_sigsegv; exit 134')


def test_guest_that_never_boots_is_unavailable(monkeypatch, run, guest):
    monkeypatch.setattr(guest, 'BOOT_TIMEOUT', 0.5)
    with pytest.raises(guest.GuestUnavailableError, match='not booted after 0.5 s'):
        run(BANNER + 'sleep 600')


def test_silent_guest_is_stopped(run, guest):
    with pytest.raises(guest.GuestError, match='(?s)printed nothing for 1.5 s.*Linux version'):
        run(FIRST_WORD + 'echo hello >/proc/self/fd/$line; sleep 600', silence=1.5)


def test_slow_guest_that_prints_is_not_stopped(run):
    talk = 'for i in 1 2 3 4 5 6; do echo $i >/proc/self/fd/$line; sleep 0.5; done; '
    assert run(FIRST_WORD + talk + 'printf 0 >"$folder/status"', silence=2.0)[1] == 0


def test_machine_without_apt_has_no_guest(monkeypatch, guest):
    monkeypatch.setattr('shutil.which', lambda tool: None)
    with pytest.raises(guest.GuestUnavailableError, match='apt-get is not on this system'):
        guest.run_in_guest(['true'])


def test_tests_without_vcan_run_and_name_the_reason(run_tests, capfd):
    assert run_tests('echo no ptrace; exit 1') == ('this machine, without a vcan', 0)
    printed = capfd.readouterr().out
    assert '!!! NO SOCKETCAN TESTS' in printed
    assert 'the last lines of its console:\nno ptrace\n' in printed
    assert printed.rstrip().endswith('does not start here: the guest died (exit status 1)')


def test_missing_vcan_fails_in_ci(monkeypatch, run_tests):
    monkeypatch.setenv('CI', 'true')
    assert run_tests('exit 1') == ('this machine, without a vcan', 1)


def test_guest_that_dies_during_tests_is_an_error(run_tests, guest):
    with pytest.raises(guest.GuestError, match='exit status 1'):
        run_tests(FIRST_WORD + 'exit 1')


def test_fetch_on_another_distribution_names_the_kernel_module(monkeypatch, guest, tmp_path):
    release = tmp_path / 'os-release'
    release.write_text('ID=ubuntu\nID_LIKE=debian\n')
    monkeypatch.setattr(guest.fetch, 'OS_RELEASE', release)
    monkeypatch.setattr(guest.fetch.shutil, 'which', lambda tool: tool)
    with pytest.raises(guest.GuestUnavailableError, match='next: sudo modprobe vcan'):
        guest.run_in_guest(['true'])
