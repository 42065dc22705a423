"""What links, robots and runs can do to a deploy, a playbook or a probe, how Lupin reacts, and the tests that prove it.

`python -m tools.write_docs` writes the table of docs/resilience.md from this one.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Event:
    """One event with Lupin's reaction, both in Markdown."""

    event: str
    reaction: str
    tests: tuple[str, ...]  # file::test


# fmt: off
EVENTS: tuple[Event, ...] = (
    Event("The link is cut in the middle of any step",
        "status 3, the step's name, `--resume`. The previous release keeps running; systemd completes a restart that has "
        "begun without the link; if the stack is down because the clock is being set, the message says so, and `--resume` "
        "starts it",
        ("tests/lupin_cli/release/test_resilience.py::test_deploy_with_cable_cut_in_every_step_resumes_to_the_end",
         "tests/lupin_cli/release/test_resilience.py::test_clock_setting_with_cable_cut_in_every_change_resumes",
         "tests/lupin_cli/release/test_release.py::test_interrupted_deploy_keeps_previous_release_and_resumes",
         "tests/lupin_cli/playbook/test_engine.py::test_connection_lost_at_any_call_is_resumed_and_undone",
         "tests/lupin_cli/connection/test_ssh_faults.py::test_link_cut_during_write_keeps_old_or_new_file")),
    Event("The robot reboots, or loses power, during a run",
        "as for a cut link; the robot boots with the previous release",
        ("tests/lupin_cli/release/test_resilience.py::test_deploy_resumes_after_power_cut_and_kill_under_its_lease",
         "tests/lupin_cli/connection/test_connection_on_host.py::test_target_reconnects_after_robot_reboots_during_run")),
    Event("A robot that accepts and never answers connections",
        "status 3 after 5 s: its sshd hangs",
        ("tests/lupin_cli/connection/test_ssh_faults.py::test_server_without_ssh_banner_is_classified",
         "tests/lupin_cli/connection/test_ssh_faults.py::test_hung_sshd_is_reported_as_silent",
         "tests/lupin_cli/release/test_resilience.py::test_refusal_is_reported_with_next_command_and_no_change")),
    Event("A connection is half open: established, then silent",
        "after every 5 s of silence Lupin asks the other side for an answer; it gives up 30 s after a request without one, "
        "whatever the step's own limit. Data that is not acknowledged for 10 s closes the connection sooner",
        ("tests/lupin_cli/connection/test_ssh_faults.py::test_silent_connection_is_given_up_before_a_long_timeout",
         "tests/lupin_cli/connection/test_ssh_faults.py::test_silent_script_on_answering_connection_is_awaited",
         "tests/lupin_cli/connection/test_ssh_faults.py::test_half_open_connection_is_given_up_at_the_timeout")),
    Event("One robot of several fails, hangs, answers late, or loses its link after the login",
        "it is reported separately, and the others as if they were alone; the exit status is the worst one",
        ("tests/lupin_cli/doctor/test_fleet_on_hosts.py::test_fleet_robots_are_diagnosed_independently",
         "tests/lupin_cli/doctor/test_fleet_on_hosts.py::test_cable_cut_after_login_affects_only_that_robot")),
    Event("A wrong key",
        "status 3, `ssh-copy-id`",
        ("tests/lupin_cli/connection/test_ssh_faults.py::test_wrong_key_error_names_ssh_copy_id",)),
    Event("A changed key",
        "status 3, even if an operator would answer yes, until the key is forgotten by name",
        ("tests/lupin_cli/connection/test_host_keys.py::test_changed_key_is_fatal_until_it_is_forgotten",
         "tests/lupin_cli/release/test_resilience.py::test_refusal_is_reported_with_next_command_and_no_change")),
    Event("A wrong user",
        "status 3, `ssh-copy-id`",
        ("tests/lupin_cli/release/test_resilience.py::test_refusal_is_reported_with_next_command_and_no_change",)),
    Event("sudo refuses, or requires a password",
        "status 1, sudo's own message, the same run with `--ask-sudo-password`, or on the laptop after `sudo -v`; the password "
        "appears in no command line",
        ("tests/lupin_cli/release/test_resilience.py::test_refusal_is_reported_with_next_command_and_no_change",
         "tests/lupin_cli/playbook/test_sudo_hints.py::test_refused_step_names_what_helps_on_its_machine",
         "tests/lupin_cli/connection/test_connection_on_host.py::test_sudo_password_is_accepted_only_if_it_is_right",
         "tests/lupin_cli/connection/test_connection_on_host.py::test_sudo_password_is_in_no_command_line_or_environment")),
    Event("A full disk",
        "a deploy reports the free and the required space before it compares or copies; an existing file is kept; leases, "
        "locks and probes need no space",
        ("tests/lupin_cli/release/test_resilience.py::test_refusal_is_reported_with_next_command_and_no_change",
         "tests/lupin_cli/connection/test_ssh.py::test_full_disk_keeps_old_file_and_is_reported")),
    Event("The laptop's disk is full, so the journal cannot be written",
        "the run stops with status 1: what cannot be journaled is not done. Its `always` steps still run, so what it has "
        "stopped is started; `lupin sync-clock` says whether the stack is up",
        ("tests/lupin_cli/playbook/test_always_steps.py::test_full_disk_at_any_line_leaves_nothing_stopped",
         "tests/lupin_cli/commands/test_sync_clock_command.py::test_journal_error_still_reports_that_the_stack_is_down")),
    Event("A read-only file system",
        "reported before anything is copied; probes work as usual",
        ("tests/lupin_cli/release/test_resilience.py::test_refusal_is_reported_with_next_command_and_no_change",
         "tests/lupin_cli/connection/test_connection_on_host.py::test_batch_works_on_full_and_read_only_disks_and_put_fails")),
    Event("A file of the release is damaged on the robot's disk, or changed by somebody",
        "no unit starts the release, and the system journal says which file differs; the doctor names it, and the next deploy "
        "installs the release again. A damaged release never becomes current",
        ("tests/lupin_cli/release/test_signing_on_host.py::test_changed_byte_is_named_refused_and_repaired",
         "tests/lupin_cli/release/test_release.py::test_damaged_release_is_installed_again",
         "tests/lupin_cli/release/test_verify_release.py::test_damage_is_named_by_path_and_reason")),
    Event("A robot with no python3",
        "probes do not need it; a deploy reports it",
        ("tests/lupin_cli/connection/test_connection_on_host.py::test_robot_without_python_and_with_chatty_shell_answers",
         "tests/lupin_cli/release/test_resilience.py::test_refusal_is_reported_with_next_command_and_no_change")),
    Event("The robot's clock stepped back by five minutes while the stack runs, by any program",
        "e-stop and drive bus keep running: none of their timers uses the wall clock",
        ("tests/lupin_cli/systemd/test_units_on_host.py::test_estop_and_drive_keep_publishing_after_clock_steps_back",)),
    Event("A stack is stopped, or one of its processes",
        "its nodes leave the graph at once: no peer sees names without samples for the 20 s of a DDS lease",
        ("tests/lupin_runtime/ros/test_node_runner.py::test_terminated_process_leaves_the_graph_at_once",)),
    Event("The last login on the robot ends, and logind removes its user's shared memory",
        "a deploy configures logind to keep it; if it happens anyway, the doctor reports it, and fixes it after a "
        "confirmation",
        ("tests/lupin_cli/doctor/test_doctor_on_host.py::test_logind_removes_shared_memory_until_fixed",)),
    Event("A robot with no chrony",
        "its clock is measured and set all the same; the boot-time unit is refused with the reason",
        ("tests/lupin_cli/release/test_resilience.py::test_robot_without_chrony_is_reported_and_its_clock_measured",)),
    Event("100 MB of output from a step or a probe",
        "of a step's output, the beginning and the end are kept, with the number of bytes between them; of a probe's, only "
        "the beginning; a journal keeps 64 kB. A parser that needs the whole output refuses a truncated one",
        ("tests/lupin_cli/connection/test_ssh.py::test_run_keeps_head_and_tail_of_100_megabytes",
         "tests/lupin_cli/connection/test_ssh.py::test_batch_truncates_100_megabytes",
         "tests/lupin_cli/playbook/test_engine.py::test_journal_keeps_head_and_tail_of_100_mb_output",
         "tests/lupin_cli/operations/test_local.py::test_probe_rejects_100_mb_of_output",
         "tests/lupin_cli/operations/test_local.py::test_guard_discards_100_mb_of_output")),
    Event("Languages, time zones and names of any kind, on either machine",
        "the same findings, the same clock, the same bytes",
        ("tests/lupin_cli/test_languages.py::test_playbook_and_journal_are_equal_in_every_locale",
         "tests/lupin_cli/connection/test_locales_and_shells.py::test_locale_zone_and_shell_do_not_change_doctor_or_clock",
         "tests/lupin_cli/connection/test_locales_and_shells.py::test_target_works_with_chatty_shell_and_foreign_locale")),
    Event("A login shell of any kind; a banner; a startup file that prints, or replaces the shell",
        "its output is not mistaken for a command's; a shell that does not run what it is given is reported",
        ("tests/lupin_cli/connection/test_locales_and_shells.py::test_target_works_with_chatty_shell_and_foreign_locale",
         "tests/lupin_cli/connection/test_locales_and_shells.py::test_bashrc_that_replaces_the_shell_is_reported")),
    Event("Two operators at once",
        "the second one learns before its first step who the first is and for how long, and waits with `lupin wait free`. The "
        "lease of the same operator's dead run is taken over; another holder's is taken only with the holder's name",
        ("tests/lupin_cli/release/test_resilience.py::test_deploy_resumes_after_power_cut_and_kill_under_its_lease",
         "tests/lupin_cli/playbook/test_lease.py::test_lease_is_granted_to_one_of_many",
         "tests/lupin_cli/playbook/test_lease.py::test_exclusive_run_without_the_lease_begins_no_step",
         "tests/lupin_cli/playbook/test_lease.py::test_shipped_playbooks_that_touch_the_stack_are_exclusive")),
    Event("Ctrl-C in any step of a run, or between two",
        "the run stops, and every `always` step that has not ended runs; of several robots, on each",
        ("tests/lupin_cli/playbook/test_always_steps.py::test_stop_between_steps_runs_every_always_step",
         "tests/lupin_cli/playbook/test_always_steps.py::test_ctrl_c_in_any_step_runs_every_always_step",
         "tests/lupin_cli/playbook/test_fleet.py::test_stop_reaches_robots_after_one_ran_its_always_steps")),
    Event("A file, a connection or the release is changed after a run, and the run is undone",
        "nothing is undone; the message names what was changed. `--force` overwrites it, and keeps a copy of a file beside it",
        ("tests/lupin_cli/playbook/test_undo.py::test_undo_is_refused_if_a_file_was_edited_since",
         "tests/lupin_cli/playbook/test_undo.py::test_forced_undo_keeps_a_copy_of_what_it_overwrites",
         "tests/lupin_cli/release/test_release.py::test_undo_does_not_take_away_a_newer_release")),
    Event("The terminal is closed, or SIGTERM, during a playbook",
        "the run goes on, or ends as after Ctrl-C; either way, what it stopped is started again",
        ("tests/lupin_cli/playbook/test_kill.py::test_run_starts_again_what_it_stopped_if_it_is_ended",)),
    Event("SIGKILL of lupin at any point",
        "`--resume` continues after the journal's last line, `--undo` restores the state before the first attempt",
        ("tests/lupin_cli/playbook/test_kill.py::test_run_killed_at_every_journal_line_is_resumed",
         "tests/lupin_cli/release/test_resilience.py::test_deploy_resumes_after_power_cut_and_kill_under_its_lease",
         "tests/lupin_cli/commands/test_sync_clock_on_host.py::test_resume_after_kill_restarts_stopped_stack")),
)
# fmt: on
