"""
Commands `scan` and `assign`: list the drives on the bus, and assign node ids through LSS.

References
----------
CiA 305, Layer setting services and protocols.

"""

from __future__ import annotations

from collections.abc import Sequence

from canopen.lss import LssError, LssMaster

from facade_manipulator.canopen import indices
from facade_manipulator.canopen.lss import (
    find_unknown_slave,
    Identity,
    lss_master,
    set_node_id,
    UNCONFIGURED,
)
from facade_manipulator.drives import configuration
from facade_manipulator.drives.profile import fitting_profile
from facade_manipulator.errors import CommissioningError
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.tools.commissioning.procedure import Context
from facade_manipulator.tools.commissioning.tool_bus import (
    BOOT_TIMEOUT,
    NODE_IDS,
    ToolBus,
)


def run_scan(context: Context) -> None:
    """Print the nodes on the bus; fail if they do not match the parameters."""
    problems = []
    with context.bus() as bus:
        context.begin('scan')
        serials = bus.serial_numbers(NODE_IDS)
        known = set().union(*serials.values())
        master = lss_master(bus, context.options.lss_timeout)
        # some nodes answer although they have a node id (Lely)
        has_new = find_unknown_slave(master, lambda one: one.serial_number in known)
        print('node  serial number     vendor    product  profile')
        for node_id, found in sorted(serials.items()):
            shown = ', '.join(map(str, sorted(found)))
            if len(found) > 1:
                problems.append(
                    f'{len(found)} drives have node id {node_id} (serial numbers '
                    f'{shown}); next: commission assign'
                )
                print(f'{node_id:<4}  {shown}')
                continue
            vendor = bus.number(node_id, indices.IDENTITY, 1)
            product = bus.number(node_id, indices.IDENTITY, 2)
            kind = 'not a drive'
            if _is_drive(bus, node_id):
                kind = fitting_profile(vendor, product)
            print(f'{node_id:<4}  {shown:13} {vendor!s:>10} {product!s:>10}  {kind}')
    if has_new:
        problems.append('a drive has no node id; next: commission assign')
    remedy = (
        'check power, plug, termination (60 ohms between CAN high and low) and bit rate'
    )
    if problems:
        remedy = 'commission assign'
    for name, axis in context.axes.items():
        if axis.node_id not in serials:
            problem = f'{name} (node {axis.node_id}) does not answer; next: {remedy}'
            problems.append(problem)
    context.record('scan', {}, problems)


def _is_drive(bus: ToolBus, node_id: int) -> bool:
    """Return whether a node is a drive; for example, an I/O module is not a drive."""
    device_type = bus.number(node_id, indices.DEVICE_TYPE) or 0
    return device_type & 0xFFFF == configuration.DEVICE_PROFILE


def run_assign(context: Context) -> None:
    """Assign each drive the node id of its carriage, store it in the drive, and record it."""
    previous = {name: axis.serial_number for name, axis in context.axes.items()}
    node_ids = {name: axis.node_id for name, axis in context.axes.items()}
    serials = context.options.serials or []
    if len({*serials}) < len(serials):
        raise CommissioningError(
            f'--serials {" ".join(map(str, serials))} rejected: two are '
            'equal; next: give the serial number of each drive'
        )
    shown = ', '.join(f'{name}: {node_id}' for name, node_id in node_ids.items())
    context.agree(
        'All drives on this bus that support LSS lose their node id. Each drive stores the '
        f'node id of its carriage ({shown}). Serial numbers and profile are written to '
        f'{context.overlay.path}. No carriage moves.'
    )
    context.state = (
        'Drives without a stored node id use the old id after power off and on'
    )
    with context.bus() as bus:
        context.begin('assign')
        given, spare_drives = _assigned_drives(context, bus, node_ids)
    changed = [name for name in given if given[name].serial_number != previous[name]]
    if repeated := context.overlay.undo(_steps_of_new_drives(changed)):
        print(
            f'another drive moves {", ".join(changed)}; next: repeat '
            f'{", ".join(repeated)}'
        )
    if missing := [name for name in node_ids if name not in given]:
        raise _missing_drives(missing, spare_drives, serials)
    profile, *others = {fitting_profile(*one[:2]) for one in given.values()}
    if others:
        raise CommissioningError(
            f'drives rejected: they have the types {profile} and '
            f'{" and ".join(others)}; next: use three drives of the same type'
        )
    context.record(
        'assign',
        {
            'axes.profile': profile,
            **{
                f'{name}.serial_number': given[name].serial_number
                for name in AXIS_NAMES
            },
        },
    )


def _assigned_drives(
    context: Context, bus: ToolBus, node_ids: dict[str, int]
) -> tuple[dict[str, Identity], list[int]]:
    """
    Assign node ids to the drives of the axes; return these drives by axis.

    Also return the serial numbers of the drives without a carriage.
    """
    given: dict[str, Identity] = {}
    spare_drives: list[int] = []
    seen: set[Identity] = set()
    master = lss_master(bus, context.options.lss_timeout)
    _configure(bus, master, UNCONFIGURED)
    while found := find_unknown_slave(master, seen.__contains__):
        seen.add(found)
        spare_id = NODE_IDS[-len(seen)]  # so that only this node answers on it
        _configure(bus, master, spare_id, found)
        if not _is_drive(bus, spare_id):
            continue
        name = _axis_of(context, found)
        if not name:
            spare_drives.append(found.serial_number)
            continue
        if name in given:
            raise CommissioningError(
                f'{name} rejected: it already has a drive; next: answer with another carriage'
            )
        _configure(bus, master, node_ids[name], found, is_stored=True)
        bus.reset(node_ids[name])
        given[name] = found
        context.state += (
            f'. {name} has stored node id {node_ids[name]} (serial number '
            f'{found.serial_number})'
        )
    return given, spare_drives


def _steps_of_new_drives(axes: Sequence[str]) -> list[str]:
    """Return the steps whose results depend on the drives of axes, not on their screws."""
    if not axes:
        return []
    commands = ('profile --check', 'direction', 'jog', 'home-switch')
    of_axes = [f'{command} {axis}' for command in commands for axis in axes]
    return ['scan', *of_axes, 'lag', 'stop-test']


def _missing_drives(
    missing: Sequence[str], spare_drives: Sequence[int], serials: Sequence[int]
) -> CommissioningError:
    """
    Return the error for axes without a drive; the caller raises it.

    `spare_drives` are the serial numbers of the drives that were found for no carriage, `serials`
    those of the option, which is empty if the operator was asked.
    """
    axes = ', '.join(missing)
    if not spare_drives:
        return CommissioningError(
            f'no drive was found with fastscan for {axes}; next: check its plug, assign '
            '--lss-timeout 0.5, or use its switches or the tool of its maker'
        )
    spare = f'found for no carriage: {", ".join(map(str, sorted(spare_drives)))}'
    if serials:
        given = dict(zip(AXIS_NAMES, serials, strict=True))
        absent = ', '.join(f'{name}: {given[name]}' for name in missing)
        message = (
            f'--serials rejected: no drive has these serial numbers ({absent}); drives {spare}; '
            'next: correct --serials'
        )
    else:
        message = (
            f'{axes} rejected: drives {spare}; next: repeat commission assign, and answer with '
            'the carriages'
        )
    if len(spare_drives) < len(missing):
        message += f', and check the plugs of the other drives of {axes}'
    return CommissioningError(message)


def _axis_of(context: Context, found: Identity) -> str:
    """Return the axis that a drive moves; '' for a drive that receives no node id."""
    if serials := context.options.serials:
        return dict(zip(serials, AXIS_NAMES, strict=True)).get(found.serial_number, '')
    answer = context.ask(
        f'Drive with serial number {found.serial_number} (product {found.product_code:X}h): which '
        f'carriage does it move? [{"/".join(AXIS_NAMES)}, or nothing]',
        '--serials',
    )
    if answer and answer not in AXIS_NAMES:
        raise CommissioningError(f'{answer} rejected: choose {", ".join(AXIS_NAMES)}')
    return answer


_BOOTING = 0.5  # s


def _configure(
    bus: ToolBus,
    master: LssMaster,
    node_id: int,
    selected: Identity | None = None,
    is_stored: bool = False,
) -> None:
    """
    Set the node id of one node, or of all nodes, and wait until they have booted.

    Some nodes use the id only after a reset of communication. Raises a CommissioningError if a
    node does not accept or store the id.
    """
    try:
        set_node_id(master, node_id, selected, is_stored)
    except LssError as error:
        raise CommissioningError(
            f'no drive has confirmed a node id through LSS ({error}); next: switch power off and '
            'on, repeat, or set node ids with switches or in the tool of their maker'
        ) from error
    bus.frames.command('RESET COMMUNICATION', 0)
    bus.wait_for(
        lambda: selected and bus.number(node_id, indices.DEVICE_TYPE) is not None,
        BOOT_TIMEOUT if selected else _BOOTING,
    )
