"""Files of config/deploy: services, recording, network."""

from configparser import ConfigParser
from importlib.util import find_spec
import os
import re
import shlex
import shutil
import subprocess

import pytest

from facade_manipulator import config_path

ETC = config_path('deploy/etc')
UNITS = ETC / 'systemd/system'
SERVICES = sorted(UNITS.glob('*.service'))
needs_systemd = pytest.mark.skipif(
    shutil.which('systemd-analyze') is None, reason='systemd-analyze is not installed'
)


def read(path) -> ConfigParser:
    unit = ConfigParser(strict=False, interpolation=None)  # systemd repeats keys
    unit.optionxform = str
    unit.read_string(re.sub(r'\\\n\s*', '', path.read_text('utf-8')))
    return unit


@pytest.mark.parametrize('node', ['driver', 'manipulator', 'disturbance_estimator'])
def test_service_starts_a_node_of_the_package(node):
    commands = [shlex.split(read(path)['Service']['ExecStart']) for path in SERVICES]
    (words,) = (
        words for words in commands if f'facade_manipulator.nodes.{node}' in words
    )
    assert find_spec(words[words.index('-m') + 1])
    assert words[words.index('--enclave') + 1] == f'/%i/{node}'


@pytest.mark.parametrize('path', SERVICES, ids=lambda path: path.stem)
def test_service_is_restarted_only_on_failure(path):
    service = read(path)['Service']
    assert service['Type'] == 'exec'
    assert service['Restart'] == 'on-failure'


#: variables with which a user selects and configures the middleware, with an example each
MIDDLEWARE = {
    'RMW_IMPLEMENTATION': 'rmw_cyclonedds_cpp',
    'ROS_DOMAIN_ID': '3',
    'ROS_DISCOVERY_SERVER': '10.0.0.1:11811',
    'ROS_SECURITY_KEYSTORE': '/opt/keys',
    'FASTRTPS_DEFAULT_PROFILES_FILE': '/opt/fast.xml',
    'FASTDDS_DEFAULT_PROFILES_FILE': '/opt/fast.xml',
    'CYCLONEDDS_URI': '<CycloneDDS><Domain Id="any"/></CycloneDDS>',
    'NDDS_QOS_PROFILES': 'file:///opt/connext.xml',
    'NDDSHOME': '/opt/connext',
    'RTI_LICENSE_FILE': '/opt/connext/license.dat',
    'ZENOH_SESSION_CONFIG_URI': '/opt/session.json5',
    'ZENOH_ROUTER_CONFIG_URI': '/opt/router.json5',
    'ZENOH_CONFIG_OVERRIDE': 'mode="client"',
}
PAGE = config_path().parent / 'docs/installation.md'


@pytest.mark.skipif(not PAGE.exists(), reason='the pages exist only in the source tree')
def test_services_get_each_variable_of_the_middleware():
    (pattern,) = re.findall(r"env \| grep -E '([^']+)'", PAGE.read_text('utf-8'))
    environment = {'PATH': os.environ['PATH'], 'HOME': '/root', **MIDDLEWARE}
    done = subprocess.run(
        ['bash', '-c', 'env | grep -E "$0"', pattern],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    kept = done.stdout.splitlines()
    assert {*kept} >= {f'{name}={value}' for name, value in MIDDLEWARE.items()}
    assert 'HOME=/root' not in kept


@needs_systemd
def test_systemd_accepts_the_units():
    command = ['systemd-analyze', 'verify', '--man=no', '--generators=no']
    environment = os.environ | {'SYSTEMD_UNIT_PATH': f'{UNITS}:'}
    done = subprocess.run(
        [*command, *UNITS.glob('facade*@.*')],
        capture_output=True,
        text=True,
        env=environment,
    )
    lines = [line for line in done.stderr.splitlines() if 'facade' in line]
    # this program is not installed here
    wrong = [line for line in lines if 'candump is not executable' not in line]
    assert not wrong


@needs_systemd
@pytest.mark.parametrize('path', SERVICES, ids=lambda path: path.stem)
def test_exposure_of_each_service_is_rated_ok(path, tmp_path):
    shutil.copytree(ETC, tmp_path / 'etc')
    command = ['systemd-analyze', 'security', '--offline=true', '--threshold=30']
    service = path.name.replace('@', '@gondola_1')
    subprocess.run(
        [*command, f'--root={tmp_path}', service], check=True, capture_output=True
    )


def test_can_interface_does_not_restart_automatically():
    can = read(ETC / 'systemd/network/80-can.network')['CAN']
    assert can['BitRate'] == '1000000'
    assert can['RestartSec'] == '0'
