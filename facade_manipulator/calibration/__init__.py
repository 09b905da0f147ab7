"""
Where the head really is: errors of the machine, of the estimator's mounting, place of the wall.

In: measurements and recordings. Out: parameters with their covariance, and what the data cannot
identify. Pure but for its command, `calibrate` (`python -m facade_manipulator.calibration`);
scipy is loaded where it is needed and by no node.
"""

from facade_manipulator.calibration.design import candidates, Noise, plan, spread
from facade_manipulator.calibration.estimator_fit import (
    EstimatorFit,
    EstimatorRecording,
    fit_estimator,
)
from facade_manipulator.calibration.geometry_fit import Identification, identify, Measurements
from facade_manipulator.calibration.recorded import (
    read_estimator_recording,
    read_touches,
    TouchRecording,
)
from facade_manipulator.calibration.tables import read_table
from facade_manipulator.calibration.unknowns import (
    BACKLASH,
    head_at,
    heads,
    screw_unknowns,
    sensitivity,
    Unknown,
    UNKNOWNS,
    unknowns_named,
    values_of,
    with_screw_tables,
    with_values,
)
from facade_manipulator.calibration.wall_fit import (
    along_wall,
    fit_wall,
    touched_points,
    WallFit,
)

__all__ = [
    'along_wall',
    'BACKLASH',
    'candidates',
    'EstimatorFit',
    'EstimatorRecording',
    'fit_estimator',
    'fit_wall',
    'head_at',
    'heads',
    'Identification',
    'identify',
    'Measurements',
    'Noise',
    'plan',
    'read_estimator_recording',
    'read_table',
    'read_touches',
    'screw_unknowns',
    'sensitivity',
    'spread',
    'touched_points',
    'TouchRecording',
    'Unknown',
    'UNKNOWNS',
    'unknowns_named',
    'values_of',
    'WallFit',
    'with_screw_tables',
    'with_values',
]
