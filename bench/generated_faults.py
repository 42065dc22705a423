"""Faults that nobody listed: each is drawn from a verb (drop, stop, edit, ...) and from what the verb can be applied to.

A fault consists of shell commands that make it and undo it on laptop or robot, and of the layer and machine at which its root
lies. These follow from what the commands touch. The doctor's tables are not used, so that a fault is judged without them.
"""

from __future__ import annotations

from bench.faults.environment import (
    edit_unit_environment,
    edit_unused_variable,
    edit_variable,
    shadow_library,
    unset_variables,
)
from bench.faults.fault import Builder
from bench.faults.files import (
    add_dead_proxy,
    break_release,
    break_vendor_file,
    change_unused_file,
    edit_exports,
    edit_login,
    edit_profile,
    edit_server_start,
    edit_time_source,
    edit_vendor_settings,
    remove_profile,
    rename_login,
    rename_shared_memory,
)
from bench.faults.interfaces import (
    edit_mtu,
    edit_neighbor,
    edit_routes,
    shape_interface,
    unplug_address,
    unplug_link,
    unplug_unused,
)
from bench.faults.packets import (
    corrupt_packets,
    delay_packets,
    deny_incoming,
    drop_fraction,
    drop_on_link,
    drop_packets,
    drop_unused,
    duplicate_packets,
    limit_bandwidth,
    reorder_packets,
)
from bench.faults.processes import (
    break_unit,
    kill_process,
    limit_files,
    limit_process,
    limit_unused,
    rename_unit,
    stop_process,
    stop_unused_unit,
    throttle_stack,
)
from bench.faults.resources import fill_a_little, fill_storage, shift_clock, shift_clock_a_little

BREAKING: tuple[Builder, ...] = (
    *(drop_packets, drop_packets, drop_packets, deny_incoming, drop_fraction, drop_on_link),
    *(delay_packets, reorder_packets, duplicate_packets, corrupt_packets),
    *(unplug_link, unplug_address, edit_routes, edit_mtu, edit_neighbor, shape_interface),
    *(stop_process, stop_process, kill_process, kill_process, limit_process, limit_files, limit_bandwidth),
    *(throttle_stack, break_unit, rename_unit),
    *(unset_variables, edit_variable, edit_variable, edit_unit_environment, shadow_library, edit_exports),
    *(edit_profile, edit_profile, remove_profile, edit_login, rename_login, add_dead_proxy),
    *(edit_vendor_settings, edit_time_source),
    *(edit_server_start, break_vendor_file, break_release, rename_shared_memory, fill_storage, shift_clock),
)
HARMLESS: tuple[Builder, ...] = (
    *(drop_unused, unplug_unused, stop_unused_unit, limit_unused, edit_unused_variable, change_unused_file),
    *(fill_a_little, shift_clock_a_little),
)
