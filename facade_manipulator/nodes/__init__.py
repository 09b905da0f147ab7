"""Nodes, one file for each: parameters, ROS-free core, publishers."""

import os

# This precedes the import of numpy, whose threads would wait busily for matrices of 3 x 3: a tenth
# of the compensator's processor time.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
