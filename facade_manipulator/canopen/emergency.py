"""Former name of `emcy`."""

from facade_manipulator.canopen.emcy import Fault as Fault
from facade_manipulator.canopen.emcy import fault as fault
