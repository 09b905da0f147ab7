"""
What a machine has done in its life: states of the drives in, lasting counters out.

`MachineCounters` counts, `CounterFile` keeps them on the disk, `kept_counters` reads them.
"""

from .counter_file import CounterFile as CounterFile
from .counter_file import kept_counters as kept_counters
from .counters import MachineCounters as MachineCounters
from .counters import ServiceSettings as ServiceSettings
