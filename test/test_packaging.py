"""Package as it is declared, installed and started."""

from importlib.metadata import distribution
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest
import setuptools
from support import wait_until
from test_layering import imported_names

from facade_manipulator import package_files
from facade_manipulator.package_files import config_path, PACKAGE

TOP = Path(__file__).resolve().parents[1]
DISTRIBUTION_OF = {
    'can': 'python-can',
    'mpl_toolkits': 'matplotlib',
    'PIL': 'pillow',
    'yaml': 'pyyaml',
}
# rosdep keys that are apt packages of Ubuntu 24.04 with the same name, and packages of Jazzy:
# read in ros/rosdistro (rosdep/python.yaml, jazzy/distribution.yaml) at 8468e88 of 2026-08-22
OF_DISTRIBUTION = (
    'can',
    'hypothesis',
    'matplotlib',
    'numpy',
    'pil',
    'pytest',
    'rich',
    'scipy',
    'yaml',
)
ROSDEP = {f'python3-{name}' for name in OF_DISTRIBUTION}
JAZZY = {
    'rclpy',
    'ament_index_python',
    'builtin_interfaces',
    'launch',
    'launch_ros',
    'rcl_interfaces',
    'std_srvs',
    'action_msgs',
    'diagnostic_msgs',
    'geometry_msgs',
    'lifecycle_msgs',
    'nav_msgs',
    'sensor_msgs',
    'std_msgs',
}
MANIFEST = ElementTree.parse(TOP / 'package.xml').getroot()
NODES = (
    'driver',
    'ik_service',
    'compensator',
    'manipulator',
    'disturbance_estimator',
    'gondola_simulator',
)
# environment of the executables while they run
SHOWN = {'drive_simulator': 'nodes 1, 2, 3', **dict.fromkeys(NODES, 'ready')}
ARGUMENTS = {  # arguments with which an executable runs here, by default none
    'calibrate': ['--help'],
    'commission': ['--help'],
    'demo': ['--help'],
    'drive_simulator': ['--interface', 'virtual'],
    'workspace_study': ['--table2'],
}
EXECUTABLES = sorted({*SHOWN, *ARGUMENTS, 'stopping'})


@pytest.fixture(scope='module')
def keywords():
    """Return the setup.py arguments for setuptools, without a build."""
    given: dict[str, object] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(TOP)
        patch.setattr(setuptools, 'setup', given.update)
        exec(compile((TOP / 'setup.py').read_text(), 'setup.py', 'exec'), {})
    return given


def distribution_name(requirement):
    return re.split(r'[^\w.-]', requirement)[0].lower()


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.parametrize('name', EXECUTABLES)
def test_executable_runs_without_home_and_docstrings(
    name, keywords, ros_domain, tmp_path
):
    scripts = dict(
        line.split(' = ') for line in keywords['entry_points']['console_scripts']
    )
    assert sorted(scripts) == EXECUTABLES
    module, _, function = scripts[name].partition(':')
    environment = {key: value for key, value in os.environ.items() if key != 'HOME'}
    log = tmp_path / 'log'
    with (
        log.open('wb') as output,
        subprocess.Popen(
            [
                sys.executable,
                '-c',
                f'from {module} import {function} as main\nraise SystemExit(main())',
                *ARGUMENTS.get(name, []),
            ],
            cwd=tmp_path,
            stdout=output,
            stderr=output,
            env=environment | {'PYTHONOPTIMIZE': '2'},
        ) as process,
    ):
        if name in SHOWN:

            def is_shown():
                return SHOWN[name] in log.read_text() or process.poll() is not None

            wait_until(is_shown, f'{name} that runs', 60.0)
            process.send_signal(signal.SIGTERM)
        assert process.wait(60.0) == 0, log.read_text()
    assert 'Traceback' not in log.read_text()
    assert log.stat().st_size


@pytest.mark.parametrize(
    'variables', [{'HOME': ''}, {'ROS_LOG_DIR': '/proc/log'}, {'ROS_LOG_DIR': '/proc'}]
)
def test_missing_log_folder_names_the_next_step(variables):
    own = {}
    for name, text in os.environ.items():
        if name not in ('ROS_HOME', 'ROS_LOG_DIR'):
            own[name] = text
    code = (
        'from facade_manipulator.nodes.run import run; raise SystemExit(run(list, []))'
    )
    done = subprocess.run(
        [sys.executable, '-c', code],
        env=own | variables,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert done.returncode == 2
    assert 'could not start: ' in done.stderr
    assert 'next: set ROS_LOG_DIR' in done.stderr


def test_data_files_are_installed_below_share(keywords):
    installed = {}
    for place, names in keywords['data_files']:
        for name in names:
            installed[name] = place
    assert (
        installed['resource/facade_manipulator']
        == 'share/ament_index/resource_index/packages'
    )
    files = []
    for folder in ('config', 'launch'):
        for path in (TOP / folder).rglob('*'):
            if path.is_file() and '__pycache__' not in path.parts:
                files.append(path.relative_to(TOP))
    assert files
    for file in files:
        assert installed[str(file)] == f'share/facade_manipulator/{file.parent}'


def test_rosdep_has_every_key_of_the_manifest():
    keys = {one.text for one in MANIFEST if one.tag.endswith('depend')}
    assert keys <= ROSDEP | JAZZY


def test_imported_packages_are_declared(keywords):
    declared = [*keywords['install_requires']]
    for extra in ('study', 'calibration', 'simulation', 'cluster'):
        declared += keywords['extras_require'][extra]
    names = {re.split(r'[<>=\[]', line)[0].lower() for line in declared}
    packages = {element.text for element in MANIFEST.iter('exec_depend')}
    known = {*sys.stdlib_module_names, 'facade_manipulator', *packages}
    used = set()
    for path in PACKAGE.rglob('*.py'):
        used |= {name.partition('.')[0] for name in imported_names(path)}
    assert not {
        name for name in used - known if DISTRIBUTION_OF.get(name, name) not in names
    }


def test_installation_page_lists_packages_that_rosdep_lacks(keywords):
    text = (TOP / 'docs/installation.md').read_text()
    (line,) = re.findall(r"^ *lacking='(.*?)'", text, re.MULTILINE)
    of_rosdep = {
        element.text.removeprefix('python3-')
        for element in MANIFEST.iter('exec_depend')
    }
    of_rosdep |= {
        'pillow' if name == 'pil' else 'pyyaml' if name == 'yaml' else f'python-{name}'
        for name in of_rosdep
    } | of_rosdep
    missing = {
        distribution_name(wanted) for wanted in keywords['install_requires']
    } - of_rosdep
    for wanted in list(missing):
        for needed in distribution(wanted).requires or ():
            if 'extra ==' not in needed:
                missing.add(distribution_name(needed))
    assert set(line.split('|')) == missing - of_rosdep


def test_nodes_and_table_tools_run_without_optional_packages():
    unwanted = {'matplotlib', 'PIL', 'scipy', 'rosbags'}
    modules = sorted(
        f'facade_manipulator.nodes.{path.stem}'
        for path in (TOP / 'facade_manipulator/nodes').glob('*.py')
    )
    subprocess.run(
        [
            sys.executable,
            '-c',
            f"""
import importlib, sys
sys.modules.update(dict.fromkeys({unwanted}))  # importing one of them is an error
for module in {modules}:
    importlib.import_module(module)
assert not {{'rich', 'can', 'canopen'}} & {{*sys.modules}}  # nodes have no bus: 8 MiB
import facade_manipulator.study.__main__""",
        ],
        check=True,
    )


def test_control_loop_imports_neither_numpy_nor_ros():
    subprocess.run(
        [
            sys.executable,
            '-c',
            """
import sys
import facade_manipulator.control_loop.control_loop
import facade_manipulator.simulation.drives.simulator
assert not {'numpy', 'rclpy'} & {*sys.modules}""",
        ],
        check=True,
    )


def test_missing_configuration_file_names_searched_folders():
    assert config_path() == TOP / 'config' or 'share' in config_path().parts
    with pytest.raises(
        FileNotFoundError, match='config/no_such_file.yaml.*searched: .+'
    ):
        config_path('no_such_file.yaml')


@pytest.mark.parametrize(
    ('prefixes', 'found'),
    [
        ('/nowhere:{}/install', 'install'),
        ('{0}/over:{0}/install', 'over'),
        ('', 'venv'),
    ],
)
def test_installed_package_finds_its_configuration(
    monkeypatch, tmp_path, prefixes, found
):
    monkeypatch.setattr(
        package_files, 'PACKAGE', tmp_path / 'site-packages/facade_manipulator'
    )
    monkeypatch.setattr(sys, 'prefix', str(tmp_path / 'venv'))
    monkeypatch.setenv('AMENT_PREFIX_PATH', prefixes.format(tmp_path))
    for prefix in ('install', 'over', 'venv'):
        (tmp_path / prefix / 'share/facade_manipulator/config').mkdir(parents=True)
    assert config_path() == tmp_path / found / 'share/facade_manipulator/config'
