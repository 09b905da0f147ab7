"""
Where the head really is: errors of the machine, of the estimator's mounting, place of the wall.

In: measurements and recordings. Out: parameters with their covariance, and what the data cannot
identify. Pure but for its command, `calibrate` (`python -m facade_manipulator.calibration`);
scipy is loaded where it is needed and by no node.
"""

from facade_manipulator.calibration.design import candidates, Noise, plan, spread
from facade_manipulator.calibration.estimator_fit import EstimatorRecording, fit_estimator
from facade_manipulator.calibration.geometry_fit import identify, Measurements
from facade_manipulator.calibration.recorded import read_estimator_recording
from facade_manipulator.calibration.tables import read_table
from facade_manipulator.calibration.unknowns import (
    head_at,
    heads,
    UNKNOWNS,
    unknowns_named,
    values_of,
)
from facade_manipulator.calibration.wall_fit import fit_wall, touched_points

__all__ = [
    'candidates',
    'EstimatorRecording',
    'fit_estimator',
    'fit_wall',
    'head_at',
    'heads',
    'identify',
    'Measurements',
    'Noise',
    'plan',
    'read_estimator_recording',
    'read_table',
    'spread',
    'touched_points',
    'UNKNOWNS',
    'unknowns_named',
    'values_of',
]
