"""
Where the head really is: errors of the machine, of estimator and sensors, place of the wall.

In: measurements and recordings. Out: parameters with their covariance, and what the data cannot
identify. Pure but for its command, `calibrate` (`python -m facade_manipulator.tools.calibration`);
scipy is loaded where it is needed and by no node.
"""
