"""Guest of the SocketCAN tests, with shell scripts instead of its kernel."""

from pathlib import Path
import sys

import pytest

VCAN = Path(__file__).parents[1] / '.ci/vcan'
# The kernel receives the folder of the order and the descriptor of the serial line.
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
    """Replace the guest's kernel by a script."""

    def use(script: str) -> None:
        kernel = guest.CACHE / 'root' / 'usr' / 'bin' / 'linux.uml'
        kernel.parent.mkdir(parents=True)
        kernel.write_text(TOLD + script)
        kernel.chmod(0o755)
        monkeypatch.setattr(guest.fetch, 'fetch', lambda folder: folder / 'root')

    yield use
    assert not list(guest.CACHE.glob('guest_*')), 'a folder was not deleted'


@pytest.fixture
def run_tests(monkeypatch, use_kernel):
    """Run a command that prints the reason for a missing vcan, with only this kernel available."""

    def run(script: str) -> tuple[str, int]:
        import vcan

        use_kernel(script)
        monkeypatch.setattr(vcan, 'NAMESPACES', ())
        monkeypatch.setattr(vcan, 'INTERFACE', Path('/nowhere'))
        return vcan.run(
            [sys.executable, '-c', f'import os; print(os.environ["{vcan.MISSING}"])']
        )

    return run


def test_slow_guest_that_prints_returns_output_and_status(guest, use_kernel, capfd):
    use_kernel(
        FIRST_WORD
        + 'for i in 1 2 3 4 5 6; do echo $i >/proc/self/fd/$line; sleep 0.5; '
        'done; printf 3 >"$folder/status"'
    )
    assert guest.run_in_guest(['true'], silence=2.0) == ('7.2.7', 3)
    assert capfd.readouterr().out.split() == [*'123456']


@pytest.mark.parametrize(
    ('script', 'error', 'message'),
    [
        (
            FIRST_WORD + 'echo "Kernel panic - not syncing"; exit 9',
            'GuestError',
            'died.*exit status 9.*Kernel panic',
        ),
        (
            FIRST_WORD + 'echo hello >/proc/self/fd/$line; sleep 600',
            'GuestError',
            'printed nothing for 1.5 s.*Linux version',
        ),
        (
            BANNER + 'echo fatal_sigsegv; exit 134',
            'GuestUnavailableError',
            'not start.*status 134.*fatal_sig',
        ),
        (BANNER + 'sleep 600', 'GuestUnavailableError', 'not booted after 0.5 s'),
    ],
)
def test_guest_failure_is_raised_with_its_console(
    monkeypatch, use_kernel, guest, script, error, message
):
    use_kernel(script)
    if 'booted' in message:
        monkeypatch.setattr(guest, 'BOOT_TIMEOUT', 0.5)
    with pytest.raises(getattr(guest, error), match=f'(?s){message}'):
        guest.run_in_guest(['true'], silence=1.5)


def test_tests_without_vcan_run_and_name_the_reason(run_tests, capfd):
    assert run_tests('echo no ptrace; exit 1') == ('this machine, without a vcan', 0)
    printed = capfd.readouterr().out
    assert '!!! NO SOCKETCAN TESTS' in printed
    assert 'the last lines of its console:\nno ptrace\n' in printed
    assert printed.rstrip().endswith(
        'does not start here: the guest died (exit status 1)'
    )


def test_missing_vcan_fails_in_ci(monkeypatch, run_tests):
    monkeypatch.setenv('CI', 'true')
    assert run_tests('exit 1') == ('this machine, without a vcan', 1)
