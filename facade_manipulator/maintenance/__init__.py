"""
What a machine has done in its life: states of the drives in, lasting counters out.

`MachineCounters` counts, `CounterFile` keeps them on the disk, `kept_counters` reads them.
"""

from facade_manipulator.maintenance.counter_file import CounterFile, kept_counters
from facade_manipulator.maintenance.counters import MachineCounters, ServiceSettings

__all__ = ['CounterFile', 'kept_counters', 'MachineCounters', 'ServiceSettings']
