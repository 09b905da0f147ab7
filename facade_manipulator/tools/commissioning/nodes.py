"""
Commands `scan` and `assign`: which drives are on the bus, and node ids by LSS.

References
----------
CiA 305, Layer setting services and protocols.

"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from canopen.lss import LssError, LssMaster

from facade_manipulator.canopen.nmt import NmtCommand
from facade_manipulator.drives.axis_settings import AXIS_NAMES
from facade_manipulator.drives.profile import fitting_profile
from facade_manipulator.errors import CommissioningError
from facade_manipulator.tools.commissioning.bus import (
    BOOT_TIMEOUT,
    NODE_IDS,
    PumpedLss,
    SERIAL_NUMBER,
    ToolBus,
)
from facade_manipulator.tools.commissioning.context import Context, table

DRIVE_TYPE = 402
UNCONFIGURED = 255
STORING_TIME = 3.0  # s; CiA 305 has no bound; 0.3 s and more were seen
_BOOTING = 0.5  # s


class Identity(NamedTuple):
    """The four numbers by which LSS selects a drive (1018h)."""

    vendor_id: int
    product_code: int
    revision_number: int
    serial_number: int


# --- scan


def run_scan(context: Context) -> int:
    """Print the nodes; return 1 if they are not as the parameters have them."""
    with context.bus() as bus:
        serials = bus.serial_numbers(NODE_IDS)
        has_new = _has_unconfigured(
            bus, {one for found in serials.values() for one in found}, context.options.lss_timeout)
        table([('node', 'serial number', 'vendor', 'product', 'profile'), *(
            (node_id, ', '.join(map(str, sorted(found))), *_type(bus, node_id, len(found) > 1))
            for node_id, found in sorted(serials.items()))])
    problems = [
        f'{len(found)} drives have node id {node_id} (serial numbers '
        f'{", ".join(map(str, sorted(found)))}); next: commission assign'
        for node_id, found in serials.items() if len(found) > 1]
    if has_new:
        problems.append('a drive has no node id; next: commission assign')
    remedy = 'commission assign' if problems else (
        'check power, plug, termination (60 ohms between CAN high and low) and bit rate')
    problems += [f'{name} (node {axis.node_id}) does not answer; next: {remedy}'
                 for name, axis in context.axes.items() if axis.node_id not in serials]
    for problem in problems:
        print(f'! {problem}')
    if not problems:
        context.record('scan')
    return 1 if problems else 0


def _type(bus: ToolBus, node_id: int, is_doubled: bool) -> tuple[object, ...]:
    """Return vendor, product code and fitting profile of a node."""
    if is_doubled:
        return '', '', ''
    vendor, product = (bus.number(node_id, 0x1018, part) for part in (1, 2))
    return vendor, product, (
        fitting_profile(vendor, product) if _is_drive(bus, node_id) else 'not a drive')


def _is_drive(bus: ToolBus, node_id: int) -> bool:
    """Return whether a node, which may be booting, is a drive and not an I/O module."""
    bus.wait_for(lambda: bus.number(node_id, 0x1000) is not None, BOOT_TIMEOUT)
    return (bus.number(node_id, 0x1000) or 0) & 0xFFFF == DRIVE_TYPE


def _has_unconfigured(bus: ToolBus, known: set[int], timeout: float) -> bool:
    """
    Return whether a node without a node id answers fastscan.

    Some answer although they have a node id (Lely): their serial numbers are known.
    """
    master = PumpedLss(bus, timeout)
    found = any(one.serial_number not in known for one in _fast_scanned(master))
    master.send_switch_state_global(LssMaster.WAITING_STATE)
    return found


def _fast_scanned(master: LssMaster) -> Iterator[Identity]:
    """Yield the nodes that answer fastscan; each is selected then, and no longer answers."""
    found: set[Identity] = set()
    master.send_switch_state_global(LssMaster.WAITING_STATE)
    while (result := master.fast_scan())[0] and (one := Identity(*result[1])) not in found:
        found.add(one)
        yield one


# --- assign


def run_assign(context: Context) -> None:
    """Give each drive the node id of its carriage, store it, and write it down."""
    node_ids = {name: axis.node_id for name, axis in context.axes.items()}
    context.agree(
        'All drives on this bus that know LSS lose their node id; each gets that of its carriage ('
        + ', '.join(f'{name}: {node_id}' for name, node_id in node_ids.items())
        + f') and stores it. {context.overlay.path} gets node id, serial number and profile. '
        'Nothing moves.')
    given: dict[str, Identity] = {}
    old = 'the others have their old node ids again after power off and on'
    context.state = f'No drive has stored a new node id; {old}'
    with context.bus() as bus:
        master = PumpedLss(bus, context.options.lss_timeout)
        for found in _found(bus, master):
            name = _axis_of(context, found)
            if name in given:
                raise CommissioningError(f'{name} rejected: it has a drive already')
            if name:
                _give(bus, master, node_ids[name], found)
                given[name] = found
                context.state = ', '.join(
                    f'{name} is node {node_ids[name]} (serial number {one.serial_number})'
                    for name, one in given.items()) + f'; {old}'
        if missing := node_ids.keys() - given.keys():
            raise CommissioningError(
                f'no drive was found by fastscan for {", ".join(sorted(missing))}; next: check '
                'its plug, assign --lss-timeout 0.5, or use its switches or the tool of its maker')
    profiles = {fitting_profile(one.vendor_id, one.product_code) for one in given.values()}
    if len(profiles) > 1:
        raise CommissioningError(
            f'drives rejected: they are of the types {", ".join(sorted(profiles))}; next: use '
            'three drives of one type')
    context.record('assign', axes={'profile': profiles.pop()}, **{
        name: {'node_id': node_ids[name], 'serial_number': found.serial_number}
        for name, found in given.items()})


def _axis_of(context: Context, found: Identity) -> str:
    """Return the axis that a drive moves, '' for a drive that gets no node id."""
    if serials := context.options.serials:
        return dict(zip(serials, AXIS_NAMES, strict=True)).get(found.serial_number, '')
    answer = context.ask(
        f'Drive with serial number {found.serial_number} (product {found.product_code:X}h): which '
        f'carriage does it move? [{"/".join(AXIS_NAMES)}, or nothing]', '--serials')
    if answer and answer not in AXIS_NAMES:
        raise CommissioningError(f'{answer} rejected: it is not one of {", ".join(AXIS_NAMES)}')
    return answer


def _found(bus: ToolBus, master: PumpedLss) -> Iterator[Identity]:
    """
    Take all node ids; yield the drives one after the other, each under a spare node id.

    So each drive answers alone; I/O modules are left out. Raises a CommissioningError if no node
    supports LSS.
    """
    master.send_switch_state_global(LssMaster.CONFIGURATION_STATE)
    _configure(bus, master, UNCONFIGURED)
    bus.collect(_BOOTING)
    seen: set[Identity] = set()
    while one := next((one for one in _fast_scanned(master) if one not in seen), None):
        seen.add(one)
        spare = NODE_IDS[-len(seen)]
        _select(master, one)
        _configure(bus, master, spare)
        if _is_drive(bus, spare):
            yield one
    master.send_switch_state_global(LssMaster.WAITING_STATE)


def _give(bus: ToolBus, master: PumpedLss, node_id: int, found: Identity) -> None:
    """Give a drive a node id, store it, and read it after a reset; a CommissioningError."""
    _select(master, found)
    _configure(bus, master, node_id, is_stored=True)
    bus.frames.command(NmtCommand.RESET_NODE, node_id)
    if not bus.wait_for(
            lambda: bus.number(node_id, *SERIAL_NUMBER) == found.serial_number, BOOT_TIMEOUT):
        raise CommissioningError(
            f'timed out after {BOOT_TIMEOUT:g} s waiting for drive {found.serial_number} as node '
            f'{node_id} after a reset; next: switch its power off and on, then scan')


def _select(master: PumpedLss, found: Identity) -> None:
    """Let only one node be configured; raises a CommissioningError if it does not answer."""
    master.send_switch_state_global(LssMaster.WAITING_STATE)
    try:
        master.send_switch_state_selective(*found)
    except LssError as error:
        raise CommissioningError(f'drive {found.serial_number} no longer answers LSS; next: check '
                                 'its plug') from error


def _configure(bus: ToolBus, master: PumpedLss, node_id: int, is_stored: bool = False) -> None:
    """Give the selected nodes a node id; some take it only when their communication is reset."""
    timeout = master.RESPONSE_TIMEOUT
    try:
        master.configure_node_id(node_id)
        if is_stored:
            master.RESPONSE_TIMEOUT = STORING_TIME
            master.store_configuration()
    except LssError as error:
        raise CommissioningError(
            f'node id {node_id} is not {"stored" if is_stored else "taken"} ({error}); next: '
            'switch the power off and on, then assign again, or set the node ids by the switches '
            'of the drives or in the tool of their maker') from error
    finally:
        master.RESPONSE_TIMEOUT = timeout
    master.send_switch_state_global(LssMaster.WAITING_STATE)
    bus.frames.command(NmtCommand.RESET_COMMUNICATION, 0)
