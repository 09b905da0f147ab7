"""Nodes, one file for each: parameters, ROS-free core, publishers."""

import os

# This line precedes the import of numpy. With 3 x 3 matrices, the threads of numpy would wait
# busily, which costs a tenth of the compensator's processor time.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
