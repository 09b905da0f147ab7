"""
Topics and services of a manipulator: the one table of them, without ROS.

The nodes declare what they publish, subscribe to, serve and call from it (`ros.publisher` and its
kin); the policy of SROS2 (config/sros2_policy.xml), the tables of docs/supervisor.md and the
layouts for viewers are made from it or held to it by tests.
"""

from __future__ import annotations

from typing import NamedTuple


class Quality(NamedTuple):
    """Quality of service: what ROS 2 calls a profile."""

    depth: int
    reliable: bool = True
    latched: bool = False  #: transient local: who subscribes later receives the last ones, too


LATEST = Quality(1)
RELIABLE = Quality(10)
LATCHED = Quality(1, latched=True)
RECENT = Quality(10, latched=True)
SENSOR = Quality(5, reliable=False)  # as rclpy's qos_profile_sensor_data
TRANSFORMS = Quality(100)

# Who takes part, by the name of the node: our own, and programs and instruments of others. A
# viewer subscribes to all topics: Foxglove, RViz, rqt, or a command such as `ros2 topic echo`.
COMPENSATOR, DRIVER, IK, SIMULATOR = 'compensator', 'driver', 'ik_service', 'gondola_simulator'
ESTIMATOR, RAIL_SENSORS = 'disturbance_estimator', 'rail_sensors'
SUPERVISOR = 'supervisor'
VIEWER = 'viewer'
NODES = (DRIVER, COMPENSATOR, IK, ESTIMATOR, SIMULATOR)
ROLES = (*NODES, SUPERVISOR, 'estimator', RAIL_SENSORS, 'force_sensor', 'camera', 'instrument',
         VIEWER)


class Topic(NamedTuple):
    """A topic; names and types as ROS has them, without the namespace."""

    name: str
    type: str
    quality: Quality
    publishers: tuple[str, ...]
    subscribers: tuple[str, ...] = ()  #: beside viewers
    #: whether it is published at the control rate: an observer requests best effort, so that the
    #: publisher never waits for it
    is_stream: bool = False
    parameter: str = ''  #: of the subscribing node, with the names if there are others or more
    #: whether the type's package may be missing: then there is no such topic
    optional: bool = False


class Service(NamedTuple):
    """A service: who offers it and who may call it."""

    name: str
    type: str
    server: str
    clients: tuple[str, ...] = (SUPERVISOR,)


POSE, STATUS = 'geometry_msgs/PoseStamped', 'diagnostic_msgs/DiagnosticStatus'
JOINTS, TRIGGER = 'sensor_msgs/JointState', 'std_srvs/Trigger'
GOAL_POSE = Topic('goal_pose', POSE, LATEST, (SUPERVISOR,), (COMPENSATOR,))
DISTURBANCE = Topic('disturbance', 'geometry_msgs/PoseWithCovarianceStamped', SENSOR,
                    ('estimator', SIMULATOR), (COMPENSATOR,))
DISTURBANCE_ODOMETRY = Topic('disturbance_odometry', 'nav_msgs/Odometry', SENSOR,
                             ('estimator', ESTIMATOR), (COMPENSATOR,))
IMU = Topic('imu', 'sensor_msgs/Imu', SENSOR, (RAIL_SENSORS, SIMULATOR), (ESTIMATOR,))
RANGE_1, RANGE_2 = (
    Topic(name, 'sensor_msgs/Range', SENSOR, (RAIL_SENSORS, SIMULATOR), (ESTIMATOR,),
          parameter='distances')
    for name in ('range_1', 'range_2'))
FIX_X = Topic('fix_x', 'geometry_msgs/PointStamped', SENSOR, (RAIL_SENSORS, SIMULATOR),
              (ESTIMATOR,), parameter='fixes')
FIX_POSE = Topic('fix_pose', 'geometry_msgs/PoseWithCovarianceStamped', SENSOR, (RAIL_SENSORS,),
                 (ESTIMATOR,), parameter='poses')
CORRECTED_POSE = Topic('corrected_pose', POSE, LATEST, (COMPENSATOR, SUPERVISOR), (IK,),
                       is_stream=True)
GOAL_STATUS = Topic('compensator/goal_status', STATUS, LATCHED, (COMPENSATOR,), (SUPERVISOR,))
REFERENCE = Topic('compensator/reference', POSE, RELIABLE, (COMPENSATOR,), is_stream=True)
JOINT_SETPOINTS = Topic('joint_setpoints', JOINTS, LATEST, (IK,), (DRIVER,), is_stream=True)
JOINT_STATES = Topic('joint_states', JOINTS, RELIABLE, (DRIVER,), (IK, SIMULATOR, SUPERVISOR),
                     is_stream=True)
END_EFFECTOR_POSE = Topic('end_effector_pose', POSE, RELIABLE, (IK,), (COMPENSATOR, SUPERVISOR),
                          is_stream=True)
SOFTWARE_STOP = Topic('software_stop', 'std_msgs/Bool', RELIABLE, (SUPERVISOR,), (DRIVER,),
                      parameter='software_stop_topics')
CONTACT_WRENCH = Topic('contact_wrench', 'geometry_msgs/WrenchStamped', SENSOR,
                       ('force_sensor', SIMULATOR), (COMPENSATOR,))
LATERAL_OFFSET = Topic('lateral_offset', 'geometry_msgs/PointStamped', SENSOR, ('camera',),
                       (COMPENSATOR,))
HEAD_ON_WALL = Topic('head_on_wall', POSE, SENSOR, ('instrument',), (SUPERVISOR,))
DRIVER_STATUS = Topic('driver/status', STATUS, LATCHED, (DRIVER,), (COMPENSATOR, IK, SUPERVISOR))
IK_STATUS = Topic('ik_service/status', STATUS, LATCHED, (IK,), (SUPERVISOR,))
REJECTIONS = Topic('ik_service/rejections', STATUS, RECENT, (IK,), (SUPERVISOR,))
ROBOT_DESCRIPTION = Topic('robot_description', 'std_msgs/String', LATCHED, (IK,))
MECHANISM_STATES = Topic('ik_service/joint_states', JOINTS, RELIABLE, (IK,), is_stream=True)
DIAGNOSTICS = Topic('/diagnostics', 'diagnostic_msgs/DiagnosticArray', RELIABLE, NODES,
                    (SUPERVISOR,))
TF = Topic('/tf', 'tf2_msgs/TFMessage', TRANSFORMS, (COMPENSATOR,), optional=True)
CARRIAGE_FORCES = Topic('gondola_simulator/carriage_forces', JOINTS, LATEST, (SIMULATOR,),
                        (DRIVER,), is_stream=True)
HEAD_POSE, RAIL_POSE = (
    Topic(f'gondola_simulator/{name}', POSE, RELIABLE, (SIMULATOR,), is_stream=True)
    for name in ('head_pose', 'rail_pose'))
# of ROS itself
ROSOUT = Topic('/rosout', 'rcl_interfaces/Log', RELIABLE, ROLES)
PARAMETER_EVENTS = Topic('/parameter_events', 'rcl_interfaces/ParameterEvent', RELIABLE, ROLES)
TRANSITION_EVENT = Topic('driver/transition_event', 'lifecycle_msgs/TransitionEvent', RELIABLE,
                         (DRIVER,))
EXECUTOR_CHECK = Topic('executor_check/message', 'std_msgs/Empty', LATEST, NODES, NODES)

SOLVE = Service('ik_service/solve', 'nav_msgs/GetPlan', IK)
ENABLE = Service('compensator/enable', 'std_srvs/SetBool', COMPENSATOR)
HOLD = Service('compensator/hold', TRIGGER, COMPENSATOR)
CANCEL = Service('compensator/cancel', 'action_msgs/CancelGoal', COMPENSATOR)
TARE = Service('compensator/tare', TRIGGER, COMPENSATOR)
CHANGE_STATE = Service('driver/change_state', 'lifecycle_msgs/ChangeState', DRIVER)
GET_STATE = Service('driver/get_state', 'lifecycle_msgs/GetState', DRIVER)
HOME = Service('driver/home', TRIGGER, DRIVER)
HALT = Service('driver/halt', TRIGGER, DRIVER)
CLEAR_FAULTS = Service('driver/clear_faults', TRIGGER, DRIVER)
SELF_TEST = Service('driver/self_test', 'diagnostic_msgs/SelfTest', DRIVER)
LIFECYCLE = tuple(
    Service(f'driver/{name}', f'lifecycle_msgs/{kind}', DRIVER, ()) for name, kind in (
        ('get_available_states', 'GetAvailableStates'),
        ('get_available_transitions', 'GetAvailableTransitions'),
        ('get_transition_graph', 'GetAvailableTransitions')))
OF_EVERY_NODE = tuple(
    Service(f'{role}/{name}', kind, role, ())
    for role in ROLES for name, kind in (
        ('list_parameters', 'rcl_interfaces/ListParameters'),
        ('get_parameters', 'rcl_interfaces/GetParameters'),
        ('describe_parameters', 'rcl_interfaces/DescribeParameters'),
        ('get_parameter_types', 'rcl_interfaces/GetParameterTypes'),
        ('set_parameters', 'rcl_interfaces/SetParameters'),
        ('set_parameters_atomically', 'rcl_interfaces/SetParametersAtomically'),
        ('get_type_description', 'type_description_interfaces/GetTypeDescription')))

TOPICS = tuple(one for one in globals().values() if isinstance(one, Topic))
SERVICES = (*(one for one in globals().values() if isinstance(one, Service)), *LIFECYCLE,
            *OF_EVERY_NODE)
