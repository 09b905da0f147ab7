"""The services of systemd: what is written, what systemd says of it, and a hung node under it."""

from __future__ import annotations

import os
from pathlib import Path
import shutil
import signal
import socket
import subprocess
import sys

import pytest
from support import children, wait_until

from facade_manipulator import config_path
from facade_manipulator.tools.deployment import main

NODES = ('driver', 'manipulator', 'recorder')
needs_systemd = pytest.mark.skipif(
    shutil.which('systemd-analyze') is None, reason='systemd-analyze is not installed')


def install(root, *arguments):
    return main(['--root', str(root), '--account', 'root', *arguments])


@needs_systemd
def test_what_is_installed_is_accepted_by_systemd_and_found_again(tmp_path, capsys):
    assert install(tmp_path) == 0
    assert 'enable --now facade@gondola_1.target' in capsys.readouterr().out
    units = tmp_path / 'etc/systemd/system'
    for node in NODES:
        text = (units / f'facade-{node}@.service').read_text()
        assert '@SYSTEM' not in text and 'User=root' in text and 'WatchdogSec' in text
        assert '--params-file /etc/facade_manipulator/%i.yaml' in text  # of the computer it is for
    assert install(tmp_path, '--check') == 0


@needs_systemd
@pytest.mark.parametrize('node', [*NODES, 'estimator'])
def test_a_service_is_exposed_no_more_than_ok(tmp_path, node):
    install(tmp_path)
    subprocess.run(['systemd-analyze', 'security', '--offline=true', f'--root={tmp_path}',
                    '--threshold=30', f'facade-{node}@gondola_1.service'],
                   check=True, capture_output=True)


def test_services_of_their_own_user_write_in_its_home_alone(tmp_path):
    install(tmp_path, '--account', 'nobody_of_this_computer')
    home = '/var/lib/facade_manipulator'
    texts = {path.name: path.read_text() for path in tmp_path.rglob('*.conf')}
    assert f'ReadWritePaths={home}/.ros\n' in texts['hardening.conf']
    # /dev/ttyUSB0 and /dev/ttyACM0 are root's and dialout's (systemd's 50-udev-default.rules)
    assert 'DeviceAllow=char-ttyUSB rw\n' in texts['hardening.conf']
    assert 'SupplementaryGroups=dialout\n' in texts['hardening.conf']
    assert 'TRANSPORTS=UDPv4' in texts['hardening.conf']  # for operators are other users
    users, folders = (
        (tmp_path / f'etc/{kind}.d/facade_manipulator.conf').read_text()
        for kind in ('sysusers', 'tmpfiles'))
    assert f'u nobody_of_this_computer - "Façade manipulator" {home}\n' in users
    assert f'd {home}/.ros - nobody_of_this_computer -\n' in folders


@needs_systemd
def test_services_of_a_user_ask_for_nothing_that_a_user_has_not(tmp_path, monkeypatch):
    monkeypatch.setenv('XDG_CONFIG_HOME', str(tmp_path))
    assert main(['--user']) == 0
    text = (tmp_path / 'systemd/user/facade-driver@.service').read_text()
    assert 'LimitRTPRIO' not in text and 'User=' not in text
    target = (tmp_path / 'systemd/user/facade@.target').read_text()
    assert 'WantedBy=default.target\n' in target  # a user's systemd has no multi-user.target
    assert main(['--user', '--check']) == 0


def test_the_users_parameter_file_stays_and_units_are_renewed(tmp_path, capsys):
    install(tmp_path)
    mine = tmp_path / 'etc/facade_manipulator/gondola_1.yaml'
    unit = tmp_path / 'etc/systemd/system/facade-driver@.service'
    mine.write_text('mine: true')
    unit.write_text('[Service]\nExecStart=/bin/false\n')
    capsys.readouterr()
    assert install(tmp_path, '--check') == 1
    assert 'facade-driver@.service differs from' in capsys.readouterr().out
    install(tmp_path)
    assert mine.read_text() == 'mine: true'
    assert 'facade_manipulator.nodes.driver' in unit.read_text()


@needs_systemd
def test_what_systemd_does_not_accept_is_told(tmp_path, monkeypatch, capsys):
    shutil.copytree(config_path('deploy'), tmp_path / 'config/deploy')
    unit = tmp_path / 'config/deploy/systemd/facade-driver@.service'
    unit.write_text(unit.read_text().replace('Type=notify', 'Type=sometimes'))
    monkeypatch.setattr('facade_manipulator.tools.deployment.config_path',
                        lambda name: (tmp_path / 'config' / name
                                      if name.startswith('deploy') else config_path(name)))
    assert install(tmp_path / 'root') == 1
    assert 'sometimes' in capsys.readouterr().err


@pytest.mark.parametrize('namespace', ['', 'two words', 'a/b', '1st', '../x'])
def test_a_namespace_that_is_none_writes_nothing(tmp_path, capsys, namespace):
    assert install(tmp_path, '--namespace', namespace) == 1
    assert 'namespace' in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_written_is_a_message(tmp_path, capsys):
    (tmp_path / 'etc').write_text('')
    assert install(tmp_path) == 1
    assert 'etc' in capsys.readouterr().err


# --- a node under a service manager

class Manager:
    """What systemd does for ``Type=notify`` and ``WatchdogSec=``, as far as a test needs it."""

    def __init__(self, folder: Path, *arguments: str, watchdog: float = 1.0) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(str(folder / 'notify'))
        self.socket.setblocking(False)
        self.command = [sys.executable, '-m', 'facade_manipulator.nodes.driver', *arguments]
        self.environment = {**os.environ, 'NOTIFY_SOCKET': str(folder / 'notify'),
                            'WATCHDOG_USEC': str(round(1e6 * watchdog))}
        self.log = folder / 'log'

    def start(self) -> subprocess.Popen:
        with self.log.open('a') as log:
            return subprocess.Popen(
                self.command, env=self.environment, stdout=log, stderr=subprocess.STDOUT)

    def heard(self) -> list[bytes]:
        said = []
        try:
            while True:
                said.append(self.socket.recv(100))
        except BlockingIOError:
            return said


@pytest.mark.realtime
def test_a_hung_driver_is_killed_and_comes_back_without_power(ros_domain, tmp_path):
    manager = Manager(tmp_path, '--ros-args', '-p', 'simulate_drives:=true',
                      '-p', 'configure_at_start:=true')
    process = manager.start()
    try:
        wait_until(lambda: b'READY=1' in manager.heard(), 'READY=1')
        wait_until(lambda: b'WATCHDOG=1' in manager.heard(), 'the watchdog to be fed')
        wait_until(lambda: 'onfigured' in manager.log.read_text(), 'the driver to configure')
        (loop,) = children(process.pid)
        process.send_signal(signal.SIGSTOP)
        manager.heard()
        with pytest.raises(pytest.fail.Exception, match='in vain'):
            wait_until(manager.heard, 'a hung node to feed', 1.2)
        process.send_signal(signal.SIGKILL)
        assert process.wait(5.0) == -signal.SIGKILL
        wait_until(lambda: not Path(f'/proc/{loop}').exists()
                   or 'Z' in Path(f'/proc/{loop}/stat').read_text().split()[2],
                   'the control loop to end by itself')
        manager.log.write_text('')
        process = manager.start()
        wait_until(lambda: 'onfigured' in manager.log.read_text(), 'the next one to configure')
        process.send_signal(signal.SIGTERM)
        assert process.wait(15.0) == 0
        assert b'STOPPING=1' in manager.heard()
    finally:
        process.kill()
        process.wait()
