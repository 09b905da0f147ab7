"""
SYNC sent by a drive, until configure disables it.

References
----------
CiA 301: synchronisation object, objects 1005h and 1006h.

"""

from __future__ import annotations

from facade_manipulator.canopen import indices
from facade_manipulator.canopen.sdo import SdoChannel, Steps
from facade_manipulator.errors import DriveObjectError

PRODUCER = 1 << 30  # bit of 1005h: the node sends SYNC with the period 1006h [us]


class SyncProducer:
    """SYNC that a drive sends itself; only this master should send SYNC."""

    def __init__(self) -> None:
        self.is_found = (
            False  #: whether the drive was found to send SYNC, also after its end
        )
        self.period = 0.0  #: period of this SYNC [s]

    def find(self, objects: SdoChannel) -> Steps[int]:
        """Return the value of 1005h, and record whether the drive sends SYNC."""
        cob_id = (yield from objects.read_informative(indices.COB_ID_SYNC, 0)) or 0
        if cob_id & PRODUCER:
            self.is_found = True
            period = yield from objects.read_informative(indices.SYNC_PERIOD, 0)
            self.period = 1e-6 * (period or 0)
        return cob_id

    def end(self, objects: SdoChannel) -> Steps[list[str]]:
        """Disable the SYNC that the drive sends; return notes for the operator."""
        cob_id = yield from self.find(objects)
        if not cob_id & PRODUCER:
            return []

        silenced = cob_id & ~PRODUCER
        found = f'{objects.title} sends SYNC itself (1005h = {cob_id:X}h)'
        remedy = f'store 1005h = {silenced:X}h in the drive'
        data = silenced.to_bytes(4, 'little')
        try:
            yield from objects.write(indices.COB_ID_SYNC, 0, data)
        except DriveObjectError as error:
            raise DriveObjectError(
                f'{found}: {error.problem}; next: {remedy}'
            ) from error

        present = yield from objects.read_optional(indices.COB_ID_SYNC, 0)
        if (present or 0) & PRODUCER:
            raise DriveObjectError(f'{found} and keeps this setting; next: {remedy}')
        return [
            f'{found} after each reset, until configure disables it; next: {remedy}'
        ]
