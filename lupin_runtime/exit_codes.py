"""The exit codes of the programs of this system, without rclpy; `lupin_cli.exit_codes` adds those of the command line."""

from __future__ import annotations

SUCCESS = 0  # done, healthy, or nothing to do
FAILURE = 1  # something failed, was declined, or needs attention
USAGE_ERROR = 2  # an argument, an option or a file of the user cannot be used
UNREACHABLE = 3  # no connection to the robot, no live run to act on, or a stack that never came up
ESTOPPED = 4  # of auto-home: the e-stop was engaged; named in RestartPreventExitStatus of its systemd unit
INTERRUPTED = 130  # Ctrl-C: 128 + SIGINT
