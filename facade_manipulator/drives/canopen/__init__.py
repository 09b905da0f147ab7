"""
CANopen (CiA 301) on a python-can bus: frames, SYNC, NMT, SDO, PDO and EMCY as tables and codecs.

In: an open interface and bytes. Out: frames, decoded messages, and errors that name object,
value and next step. Knows nothing of motors.
"""

from facade_manipulator.drives.canopen import pdo as pdo

from .bus import BusCongestedError as BusCongestedError
from .bus import BusStatistics as BusStatistics
from .bus import can_bus as can_bus
from .bus import CanBus as CanBus
from .bus import Condition as Condition
from .bus import condition_of as condition_of
from .bus import ERROR_FRAME as ERROR_FRAME
from .bus import Frame as Frame
from .eds import misfit as misfit
from .eds import read_dictionary as read_dictionary
from .eds import stated as stated
from .eds import variables as variables
from .emergency import decode_emergency as decode_emergency
from .emergency import describe as describe
from .emergency import Emergency as Emergency
from .emergency import encode_emergency as encode_emergency
from .emergency import Fault as Fault
from .emergency import fault as fault
from .emergency import is_error_reset as is_error_reset
from .link import BusSettings as BusSettings
from .link import open_bus as open_bus
from .nmt import NMT_TRANSITIONS as NMT_TRANSITIONS
from .nmt import NmtCommand as NmtCommand
from .nmt import NmtState as NmtState
from .pdo import Pdo as Pdo
from .pdo import Write as Write
from .sdo import expedited_download as expedited_download
from .sdo import Patience as Patience
from .sdo import PumpedNetwork as PumpedNetwork
from .sdo import SDO_FRAME_LENGTH as SDO_FRAME_LENGTH
from .sdo import SdoAbortError as SdoAbortError
from .sdo import SdoChannel as SdoChannel
