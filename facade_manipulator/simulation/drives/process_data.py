"""
Process data of a simulated drive, defined by its communication and mapping objects.

The PDO maps of the library map and pack the objects. This module adds the behaviour of a drive: it
rejects a wrong order of configuration, acts at the SYNC and checks lengths.

References
----------
CiA 301, PDO communication and mapping parameters, transmission types.

"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cached_property, partial

from canopen import SdoAbortedError
from canopen.pdo.base import PDO_NOT_VALID, PdoBase, PdoMap
from canopen.sdo import constants

from facade_manipulator.canopen import indices
from facade_manipulator.canopen.pdo import MAPPING_OFFSET, Pdo, PDO_NAMES
from facade_manipulator.simulation.drives.objects import Objects


class ProcessData:
    """
    PDOs of one drive, which sends TPDOs only in answer to SYNC.

    `on_short_frame` is called when an RPDO is too short for its mapping.
    """

    _PARAMETERS = [Pdo(name).communication_index for name in PDO_NAMES]

    def __init__(self, objects: Objects, on_short_frame: Callable[[], None]) -> None:
        self._objects = objects
        self._on_short_frame = on_short_frame
        for communication in self._PARAMETERS:
            objects.writers[communication, 1] = self.forget
            for subindex in range(9):
                objects.writers[communication + MAPPING_OFFSET, subindex] = partial(
                    self._check_mapping, communication, subindex
                )

    def forget(self, value: int = 0) -> None:
        """Drop the RPDOs that wait for SYNC after a PDO change, NMT state change or reset."""
        for name in ('received', '_transmitted'):
            vars(self).pop(name, None)
        self._syncs = 0

    def _check_mapping(self, communication: int, subindex: int, value: int) -> None:
        """Reject a change while the PDO or its count is enabled, and an unmappable object."""
        values = self._objects.values
        is_enabled = not values[communication, 1] & PDO_NOT_VALID
        if is_enabled or subindex and values[communication + MAPPING_OFFSET, 0]:
            raise SdoAbortedError(constants.ABORT_APPLICATION_DEVICE_STATE)
        variable = self._objects.variables.get((value >> 16, value >> 8 & 0xFF))
        if subindex and (
            variable is None
            or not variable.pdo_mappable
            or len(variable) != value & 0xFF
        ):
            raise SdoAbortedError(constants.ABORT_PDO_CANNOT_MAP)

    @cached_property
    def received(self) -> dict[int, PdoMap]:
        """Return the enabled RPDOs by COB-ID."""
        found = {}
        for one in _enabled(self._objects.rpdo):
            if one.cob_id is not None:
                found[one.cob_id] = one
        return found

    @cached_property
    def _transmitted(self) -> list[PdoMap]:
        return _enabled(self._objects.tpdo)

    def receive(self, cob_id: int, data: bytes, now: float) -> None:
        """Receive an RPDO, which takes effect at the next SYNC."""
        rpdo = self.received[cob_id]
        if 8 * len(data) < rpdo.length:
            self._on_short_frame()
        else:
            rpdo.data = bytearray(data)
            rpdo.is_received = True

    def answer_sync(self) -> None:
        """Send the TPDOs triggered by a SYNC, with the current values."""
        self._syncs += 1
        for tpdo in self._transmitted:
            if self._syncs % (tpdo.trans_type or 1) == 0:
                for variable in tpdo.map:
                    variable.raw = self._objects.read(
                        (variable.index, variable.subindex)
                    )
                tpdo.transmit()

    def latch(self) -> None:
        """Apply the RPDOs received since the last SYNC."""
        for rpdo in self.received.values():
            # the controlword last, because it acts on the mode and the target that the frames
            # contain
            for variable in sorted(
                rpdo.map, key=lambda each: each.index == indices.CONTROLWORD
            ):
                if rpdo.is_received:
                    # after a rejection the object keeps its value
                    with suppress(SdoAbortedError):
                        self._objects.write(
                            (variable.index, variable.subindex), variable.raw
                        )
            rpdo.is_received = False


def _enabled(pdos: PdoBase) -> list[PdoMap]:
    """Return the enabled PDOs with objects, as configured by the objects of the drive."""
    for one in pdos.values():
        one.is_received = False
        with suppress(KeyError):  # the drive lacks one of its objects
            one.read()
    return [one for one in pdos.values() if one.enabled and one.map]
