"""
What became of the parameters of the release before, so that its files start with a warning.

One line a name, to be deleted one release later. `RENAMED` leads to the present name, `REMOVED`
says what holds now. A name that ends in ``.*`` stands for all below it.
"""

from collections.abc import Mapping

RENAMED = {
    'border.margin': 'workspace_limit.margin',
}

REMOVED = {
    # compensator
    'estimate.future_tolerance': 'is fixed at 0.01 s now',
    'estimate.displacement_jump': 'is fixed at 0.03 m now',
    'estimate.yaw_jump': 'is fixed at 0.03 rad now',
    'estimate.fastest': 'is fixed at 1 m/s and 1 rad/s now',
    'estimate.least_noise': 'is fixed at 1e-4 m and 1e-4 rad now',
    'correction.settling_time': 'is fixed at 0.5 s now',
    'correction.smoothing': 'is fixed at 0.03 s now',
    'correction.blend_acceleration': 'is fixed at 0.5 m/s^2, 0.5 m/s^2, 1 rad/s^2 now',
    'border.knee': 'is fixed at 0.03 m now',
    'border.height_knee': 'is fixed at 0.01 m now',
    'border.yaw_knee': 'is fixed at 0.02 rad now',
    'prediction.evaluation_horizon': 'is fixed at 0.12 s now',
    'prediction.judged_horizon': 'is fixed at 0.12 s now',
    'prediction.speed': 'is fixed at 2 m/s and 2 rad/s now',
    'estimate.longest_age': 'is fixed at 0.3 s now',
    'estimate.largest_displacement': 'is fixed at 2 m now',
    'estimate.largest_yaw': 'is fixed at 0.6 rad now',
    'following.distance': 'is fixed at 0.02 m now',
    'following.patience': 'is fixed at 0.5 s now',
    'following.yaw': 'is fixed at 0.035 rad now',
    'following.lag_memory': 'is fixed at 10 s now',
    'following.greatest_lag': 'is fixed at 0.05 s now',
    'lateral.proportional': 'is fixed at 0.3 now',
    'lateral.filter_time': 'is fixed at 0.1 s now',
    'lateral.speed': 'is fixed at 0.05 m/s now',
    'lateral.longest_age': 'is fixed at 0.3 s now',
    **{f'{section}.{name}': 'is not used now: the stiffness of the contact is learnt'
       for section, names in (
           ('impedance', ('mass', 'damping', 'observer_time', 'approach_speed', 'speed',
                          'longest_age')),
           ('yaw_impedance', ('mass', 'damping', 'contact_stiffness', 'observer_time',
                              'approach_speed', 'speed', 'longest_age')))
       for name in names},
    **{f'prediction.{name}': 'is no longer used: the prediction learns by itself' for name in (
        'model', 'jerk_noise', 'cable_length', 'frequencies', 'gusts', 'offset_drift',
        'frequency_drift', 'mean_time', 'decisiveness', 'window', 'bandwidth', 'longest_gap')},
    # ik_service
    'path_spacing': 'is fixed at 0.005 m now, where a request names no tolerance',
    'longest_path': 'is fixed at 10000 poses now',
    'stream_gap': 'is fixed at 0.2 s now',
    'lead': 'is fixed at 0.05 s now',
    'workspace.theta_step': 'is fixed at 0.01 rad now',
    'friction.stiction_speed': 'is fixed at 0.002 m/s now',
    # driver
    'controller.max_bus_load': 'is fixed at 0.5 now',
    'controller.hold_cycles': 'is fixed at 20 now',
    'controller.rest_speed': 'is fixed at 0.002 m/s now',
    'controller.step_margin': 'is fixed at 1.1 now',
    'controller.max_resets_per_minute': 'is fixed at 3 now',
    'controller.reopen_after': 'is fixed at 1 s now',
    'controller.heartbeat_period': 'is fixed at 0.05 s now',
    'controller.step_timeout': 'is fixed at 1 s now',
    'controller.ramp_timeout': 'is fixed at 5 s now',
    **{f'{axis}.{name}': instead for axis in ('q1', 'q2', 'q3') for name, instead in {
        'lower_limit': 'is the first of geometry.stroke now',
        'upper_limit': 'is the second of geometry.stroke now',
        'following_error_time': 'is fixed at 0.01 s now',
        'homing_acceleration': 'is fixed at 0.5 m/s^2 now',
        'homing_zero_speed': 'is a fifth of homing_speed now',
        'homing_timeout': 'is now the time of three strokes at homing_speed',
    }.items()},
    'controller.own_garbage_collection': 'is fixed at true now',
    **dict.fromkeys(
        ('recorder.directory', 'recorder.duration', 'recorder.aftermath', 'recorder.frame_rate',
         'recorder.max_files'), 'belongs to the node recorder now, which keeps the black box'),
    'stream.oldest': 'is fixed at 0.2 s now',
    'stream.earliest': 'is fixed at 1 s now',
    # gondola_simulator
    **{f'{section}.*': "is read from the scenario's file alone now" for section in (
        'mission', 'sway', 'gondola', 'wind', 'estimator', 'facade', 'wall')},
}


def advice(name: str, removed: Mapping[str, str] = REMOVED) -> str | None:
    """Return what holds in place of a removed parameter, None if there never was one."""
    return removed.get(name) or removed.get(f'{name.partition(".")[0]}.*')


def is_old(name: str) -> bool:
    """Return whether the release before had a parameter of this name."""
    return name in RENAMED or advice(name) is not None
