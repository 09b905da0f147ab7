"""
What a machine has done in its life: states of the drives in, lasting counters out.

`MachineCounters` counts, `CounterFile` keeps them on the disk.
"""

from facade_manipulator.maintenance.counter_file import CounterFile
from facade_manipulator.maintenance.counters import MachineCounters, ServiceSettings

__all__ = ['CounterFile', 'MachineCounters', 'ServiceSettings']
