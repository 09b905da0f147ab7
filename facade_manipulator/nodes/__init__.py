"""The nodes, one executable a file: parameters, pure core, publishers."""

import os

# Before numpy: its threads would wait busily for matrices of 3 x 3, a tenth of the compensator.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
