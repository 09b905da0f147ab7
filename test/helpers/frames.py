"""The process data of the default map as bytes, built and read as tests of a bus want them."""

from __future__ import annotations

from typing import NamedTuple

from facade_manipulator.drives.canopen.pdo import RPDO1, TPDO1, TPDO2, TPDO3


class TargetFrame(NamedTuple):
    """What the master commands."""

    controlword: int
    mode: int
    target_counts: int


class StatusFrame(NamedTuple):
    """State, mode and actual position."""

    statusword: int
    mode: int
    position_counts: int


class MotionFrame(NamedTuple):
    """Actual velocity in the drive's velocity unit, and following error."""

    velocity: int
    following_error_counts: int


class ConditionFrame(NamedTuple):
    """Error code, torque in thousandths of the rated torque, digital inputs 60FD."""

    error_code: int
    torque: int
    digital_inputs: int


def encode_rpdo1(controlword: int, mode: int, target_counts: int) -> bytes:
    return RPDO1.codec.pack(controlword, mode, target_counts)


def decode_rpdo1(data: bytes) -> TargetFrame:
    return TargetFrame._make(RPDO1.codec.unpack(data))


def encode_tpdo1(statusword: int, mode: int, position_counts: int) -> bytes:
    return TPDO1.codec.pack(statusword, mode, position_counts)


def decode_tpdo1(data: bytes) -> StatusFrame:
    return StatusFrame._make(TPDO1.codec.unpack(data))


def decode_tpdo2(data: bytes) -> MotionFrame:
    return MotionFrame._make(TPDO2.codec.unpack(data))


def decode_tpdo3(data: bytes) -> ConditionFrame:
    return ConditionFrame._make(TPDO3.codec.unpack(data))
