"""The package as it is laid out, declared and installed."""

from __future__ import annotations

import ast
import importlib
from importlib.metadata import distribution, PackageNotFoundError
import os
from pathlib import Path
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest
from support import nodes

import facade_manipulator
from facade_manipulator import config_path, resources

TOP = Path(__file__).resolve().parents[1]
AGREED = {
    'package.xml', 'setup.py', 'setup.cfg', 'README.md', 'CHANGELOG.rst', 'LICENSE', 'Makefile',
    'pyproject.toml', '.gitignore', '.ci', 'docs', 'facade_manipulator', 'config', 'launch',
    'test', 'resource',
}
EXECUTABLES = {
    'driver', 'ik_service', 'compensator', 'manipulator', 'drive_simulator', 'gondola_simulator',
    'demo', 'workspace_study', 'calibrate', 'disturbance_estimator', 'commission', 'stopping',
}
DISTRIBUTION_OF = {
    'can': 'python-can', 'mpl_toolkits': 'matplotlib', 'PIL': 'pillow', 'yaml': 'pyyaml'}
# what rosdep has for Ubuntu 24.04 as a package of apt of that name, and what Jazzy has:
# read in ros/rosdistro (rosdep/python.yaml, jazzy/distribution.yaml) at 8468e88 of 2026-08-22
ROSDEP = {f'python3-{name}' for name in (
    'can', 'hypothesis', 'matplotlib', 'numpy', 'pil', 'pytest', 'rich', 'scipy', 'yaml')}
JAZZY = {
    'rclpy', 'ament_index_python', 'builtin_interfaces', 'launch', 'launch_ros', 'rcl_interfaces',
    'std_srvs', *(f'{name}_msgs' for name in (
        'action', 'diagnostic', 'geometry', 'lifecycle', 'nav', 'sensor', 'std'))}
MANIFEST = ElementTree.parse(TOP / 'package.xml').getroot()


def setup_keywords() -> dict[str, object]:
    """Run setup.py without building anything and return what it tells setuptools."""
    import setuptools

    told: dict[str, object] = {}
    original = setuptools.setup
    setuptools.setup = lambda **keywords: told.update(keywords)
    try:
        exec(compile((TOP / 'setup.py').read_text(), 'setup.py', 'exec'), {})
    finally:
        setuptools.setup = original
    return told


@pytest.fixture(scope='module')
def keywords():
    pytest.importorskip('setuptools')
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(TOP)
        return setup_keywords()


@pytest.fixture
def scripts(keywords) -> dict[str, str]:
    lines = keywords['entry_points']['console_scripts']
    return dict(re.split(r'\s*=\s*', line) for line in lines)


def test_the_top_level_is_what_was_agreed():
    listing = subprocess.run(['git', 'ls-files'], cwd=TOP, capture_output=True, text=True)
    if listing.returncode:
        pytest.skip('not a git checkout')
    assert {line.split('/')[0] for line in listing.stdout.splitlines()} <= AGREED


def test_the_installed_version_is_the_declared_one(keywords):
    try:
        installed = distribution('facade_manipulator')
    except PackageNotFoundError:
        pytest.skip('runs from the source tree without being installed')
    if '"editable": true' in (installed.read_text('direct_url.json') or ''):
        pytest.skip('what is editable has the version of its installation')
    assert installed.version.partition('+')[0] == keywords['version'].partition('+')[0]


def test_version_of_a_checkout_names_its_commit(tmp_path):
    assert resources.commit(tmp_path) == ''
    if (TOP / '.git').exists():
        head = subprocess.run(['git', 'rev-parse', 'HEAD'], cwd=TOP, capture_output=True,
                              text=True, check=True).stdout
        present, _, state = resources.commit(TOP).removeprefix('+g').partition('.')
        assert head.startswith(present) and len(present) >= 7 and state in ('', 'dirty')
        assert resources.version().partition('+')[2].startswith(f'g{present}')


@pytest.mark.parametrize('metadata', ['dist-info/METADATA', 'egg-info/PKG-INFO'])
def test_version_is_read_beside_the_code_that_runs(monkeypatch, tmp_path, metadata):
    for place, version in (('first', '9'), ('code', '1+ga')):
        file = tmp_path / place / f'facade_manipulator-{version}.{metadata}'
        file.parent.mkdir(parents=True)
        file.write_text(f'Metadata-Version: 2.1\nName: facade_manipulator\nVersion: {version}\n')
        (tmp_path / place / 'broken-1.dist-info').mkdir()
    (tmp_path / 'code/facade_manipulator-0.dist-info').mkdir()
    monkeypatch.syspath_prepend(tmp_path / 'first')
    monkeypatch.setattr(resources, 'PACKAGE', tmp_path / 'code/facade_manipulator')
    assert resources.version.__wrapped__() == '1+ga'
    monkeypatch.setattr(resources, 'PACKAGE', tmp_path / 'nowhere/facade_manipulator')
    assert resources.version.__wrapped__() == 'unknown'


def test_the_executables_are_those_of_the_interface(scripts):
    assert set(scripts) == EXECUTABLES


@pytest.mark.parametrize('name', sorted(EXECUTABLES))
def test_an_executable_can_be_started(scripts, name):
    module, function = scripts[name].split(':')
    assert callable(getattr(importlib.import_module(module), function))


@pytest.mark.parametrize('folder', ['config', 'launch'])
def test_every_file_of_a_data_folder_is_installed_in_its_place_below_share(keywords, folder):
    files = {path.relative_to(TOP) for path in (TOP / folder).rglob('*')
             if path.is_file() and '__pycache__' not in path.parts}
    installed = [(Path(place), Path(name)) for place, names in keywords['data_files']
                 for name in names if Path(name).parts[0] == folder]
    assert {name for _, name in installed} >= files
    assert all(place == 'share/facade_manipulator' / name.parent for place, name in installed)


def test_the_ament_index_finds_the_package(keywords):
    assert ('share/ament_index/resource_index/packages',
            ['resource/facade_manipulator']) in keywords['data_files']
    assert (TOP / 'resource' / 'facade_manipulator').is_file()


def test_rosdep_has_every_key_of_the_manifest():
    keys = {one.text for one in MANIFEST if one.tag.endswith('depend')}
    assert keys <= ROSDEP | JAZZY


def test_the_manifest_is_what_bloom_and_colcon_accept():
    paths = [TOP / '.venv/colcon', *map(Path, sys.path)]  # make test puts it there
    if not any((path / 'catkin_pkg').is_dir() for path in paths):
        pytest.skip('catkin_pkg is not installed')
    done = subprocess.run(
        [sys.executable, '-c', 'from catkin_pkg.package import parse_package as parse\n'
         'warnings = []\nparse("package.xml", warnings=warnings).validate(warnings=warnings)\n'
         'print(*warnings)'],
        cwd=TOP, text=True, capture_output=True,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(map(str, paths))})
    assert (done.returncode, done.stdout.strip()) == (0, ''), done.stderr


def test_what_is_imported_is_declared(keywords):
    declared = [*keywords['install_requires'], *(
        one for extra in ('study', 'calibration', 'simulation', 'cluster')
        for one in keywords['extras_require'][extra])]
    names = {re.split(r'[<>=\[]', line)[0].lower() for line in declared}
    packages = {element.text for element in MANIFEST.iter('exec_depend')}
    known = {*sys.stdlib_module_names, 'facade_manipulator', *packages}
    missing = {name for name in third_party_imports() - known
               if DISTRIBUTION_OF.get(name, name) not in names}
    assert not missing


def test_what_rosdep_cannot_install_is_in_the_documents(keywords):
    text = (TOP / 'docs/installation.md').read_text()
    (line,) = re.findall(r"^ *lacking='(.*?)'", text, re.MULTILINE)
    of_rosdep = {element.text.removeprefix('python3-') for element in MANIFEST.iter('exec_depend')}
    of_rosdep |= {'pillow' if name == 'pil' else 'pyyaml' if name == 'yaml' else f'python-{name}'
                  for name in of_rosdep} | of_rosdep
    missing = {distribution_name(wanted) for wanted in keywords['install_requires']} - of_rosdep
    missing |= {distribution_name(needed) for wanted in missing
                for needed in distribution(wanted).requires or () if 'extra ==' not in needed}
    assert set(line.split('|')) == missing - of_rosdep
    assert not [name for name in of_rosdep if name.endswith('-pip')]


def distribution_name(requirement):
    return re.split(r'[^\w.-]', requirement)[0].lower()


def test_whatever_is_fetched_is_known_by_its_hash(keywords):
    lines = (TOP / '.ci/constraints.txt').read_text().splitlines()[1:]
    assert not [line for line in lines if not re.search('( --hash=sha256:[0-9a-f]{64})+$', line)]
    wanted = [*keywords['install_requires'], *sum(keywords['extras_require'].values(), [])]
    assert {distribution_name(one) for one in wanted} <= {distribution_name(one) for one in lines}


def test_no_node_needs_what_draws_and_fits(keywords):
    unwanted = {'matplotlib', 'PIL', 'scipy', 'rosbags'}
    assert {DISTRIBUTION_OF.get(name, name) for name in unwanted} == {
        distribution_name(wanted) for extra in ('study', 'calibration')
        for wanted in keywords['extras_require'][extra]}
    nodes = sorted(f'facade_manipulator.nodes.{path.stem}' for path in (
        TOP / 'facade_manipulator/nodes').glob('*.py'))
    nodes.append('facade_manipulator.control_loop.__main__')
    subprocess.run([sys.executable, '-c', f"""
import importlib, sys
sys.modules.update(dict.fromkeys({unwanted}))  # to import one of them is an error
for module in {nodes}:
    importlib.import_module(module)"""], check=True)


def third_party_imports() -> set[str]:
    found = set()
    for path in Path(facade_manipulator.__file__).parent.rglob('*.py'):
        for node in nodes(path):
            if isinstance(node, ast.Import):
                found |= {alias.name.split('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                found.add(node.module.split('.')[0])
    return found


def test_a_configuration_file_is_found_beside_the_code():
    assert config_path() == TOP / 'config' or 'share' in config_path().parts
    assert config_path('drives').is_dir()


def test_a_missing_configuration_file_is_an_error_that_names_the_places():
    with pytest.raises(FileNotFoundError, match='config/no_such_file.yaml.*searched: .+'):
        config_path('no_such_file.yaml')


@pytest.fixture
def installed_package(monkeypatch, tmp_path):
    """Pretend that the code lies in site-packages, with no data beside it."""
    monkeypatch.setattr(resources, 'PACKAGE', tmp_path / 'site-packages' / 'facade_manipulator')
    return tmp_path


def put(prefix: Path) -> Path:
    file = prefix / 'share' / 'facade_manipulator' / 'config' / 'manipulator.yaml'
    file.parent.mkdir(parents=True)
    file.touch()
    return file


def test_an_installed_package_finds_its_ament_prefix(monkeypatch, installed_package):
    file = put(installed_package / 'install')
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'/nowhere:{installed_package}/install')
    assert config_path('manipulator.yaml') == file


def test_a_package_installed_by_pip_alone_finds_its_prefix(monkeypatch, installed_package):
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    monkeypatch.setattr(sys, 'prefix', str(installed_package / 'venv'))
    file = put(installed_package / 'venv')
    assert config_path('manipulator.yaml') == file


def test_an_overlay_hides_what_it_overlays(monkeypatch, installed_package):
    over, under = put(installed_package / 'over'), put(installed_package / 'under')
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'{installed_package}/over:{installed_package}/under')
    assert config_path('manipulator.yaml') == over != under
