"""The guest of the SocketCAN tests, with scripts in the place of its kernel."""

from __future__ import annotations

from pathlib import Path
import shutil
import sys

import pytest

SOCKETCAN = Path(__file__).parent / 'socketcan'
# what the kernel is told: where the order lies, which descriptor is the serial line, and how its
# processes are to call it
TOLD = r"""#!/bin/sh
for option; do
  case $option in
    seccomp=on) quick=1 ;;
    init=*) folder=${option#init=?}; folder=${folder%/init?} ;;
    ssl0=*) line=${option#ssl0=null,fd:} ;;
  esac
done
"""
BANNER = 'echo Linux version 7.2.7 and more\n'
FIRST_WORD = BANNER + 'touch "$folder/alive"\n'


@pytest.fixture
def guest(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(SOCKETCAN)
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


def test_the_exit_status_and_the_output_come_out_of_the_guest(run, capfd):
    assert run(
        FIRST_WORD + 'echo hello >/proc/self/fd/$line; printf 3 >"$folder/status"') == ('7.2.7', 3)
    assert capfd.readouterr().out == 'hello\n'


def test_a_guest_that_dies_in_the_middle_is_an_error_with_its_console(run, guest):
    with pytest.raises(guest.GuestError, match='(?s)died.*exit status 9.*Kernel panic'):
        run(FIRST_WORD + 'echo "Kernel panic - not syncing"; exit 9')


def test_a_guest_that_dies_before_its_first_word_is_not_available_here(run, guest):
    with pytest.raises(guest.GuestUnavailableError, match='(?s)not start.*status 134.*fatal_sig'):
        run(BANNER + 'echo fatal_sigsegv; exit 134')


def test_a_guest_that_never_says_a_word_is_not_available_here(monkeypatch, run, guest):
    monkeypatch.setattr(guest, 'START', 0.5)
    with pytest.raises(guest.GuestUnavailableError, match='not begun after 0.5 s'):
        run(BANNER + 'sleep 600')


def test_a_guest_that_starts_only_when_it_is_traced_is_traced(run):
    dies = '[ -z "$quick" ] || exit 1\n'
    assert run(dies + FIRST_WORD + 'printf 5 >"$folder/status"') == ('7.2.7', 5)


def test_a_guest_that_stands_still_is_stopped(run, guest):
    with pytest.raises(guest.GuestError, match='(?s)nothing for 1.5 s.*Linux version'):
        run(FIRST_WORD + 'echo hello >/proc/self/fd/$line; sleep 600', silence=1.5)


def test_a_guest_that_talks_may_take_its_time(run):
    talk = 'for i in 1 2 3 4 5 6; do echo $i >/proc/self/fd/$line; sleep 0.5; done; '
    assert run(FIRST_WORD + talk + 'printf 0 >"$folder/status"', silence=2.0)[1] == 0


def test_a_machine_without_apt_has_no_guest(monkeypatch, guest):
    monkeypatch.setattr('shutil.which', lambda tool: None)
    with pytest.raises(guest.GuestUnavailableError, match='apt-get is not on this system'):
        guest.run_in_guest(['true'])


def test_the_tests_run_without_a_vcan_and_are_told_why(run_tests, capfd):
    assert run_tests('echo no ptrace; exit 1') == ('this machine, without a vcan', 0)
    printed = capfd.readouterr().out
    assert '!!! NO SOCKETCAN TESTS' in printed
    assert 'the last lines of its console:\nno ptrace\n' in printed
    assert printed.rstrip().endswith('does not start here: the guest died (exit status 1)')


def test_where_every_test_must_run_no_vcan_is_a_failure(monkeypatch, run_tests):
    monkeypatch.setenv('CI', 'true')
    assert run_tests('exit 1') == ('this machine, without a vcan', 1)


def test_a_guest_that_dies_in_the_middle_of_tests_is_no_reason_to_skip_them(run_tests, guest):
    with pytest.raises(guest.GuestError, match='exit status 1'):
        run_tests(FIRST_WORD + 'exit 1')


@pytest.fixture
def ubuntu(monkeypatch, guest, tmp_path):
    release = tmp_path / 'os-release'
    release.write_text('ID=ubuntu\nID_LIKE=debian\n')
    monkeypatch.setattr(guest.fetch, 'OS_RELEASE', release)
    if not shutil.which('apt-get'):
        pytest.skip('no apt-get here')
    return guest


def test_a_distribution_that_is_not_debian_asks_for_a_mirror(monkeypatch, ubuntu):
    monkeypatch.delenv(ubuntu.fetch.MIRROR, raising=False)
    with pytest.raises(ubuntu.GuestUnavailableError, match='set DEBIAN_MIRROR to the URL'):
        ubuntu.run_in_guest(['true'])


def test_the_mirror_that_the_environment_names_is_asked(monkeypatch, ubuntu, tmp_path):
    monkeypatch.setenv(ubuntu.fetch.MIRROR, f'file:{tmp_path}/no mirror')
    with pytest.raises(ubuntu.GuestUnavailableError, match='apt-get update failed.*no'):
        ubuntu.run_in_guest(['true'])
