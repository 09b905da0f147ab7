"""
CANopen on a python-can bus; each module implements a chapter of a CiA standard.

Tables of numbers: `cob_ids` (predefined connection set), `indices` (objects of a drive).
CiA 301: `nmt` (commands, boot-up, heartbeat), `sync`, `sdo`, `pdo`, `emcy`.
CiA 305: `lss` (node ids). CiA 306: `eds` (data sheets).
The bus below them: `bus` (frames), `link` (settings and state of the interface), `clock`.

The input is an open interface and its bytes. The output is frames, decoded messages, and errors
that name object, value and next step. The package is independent of motors.
"""
