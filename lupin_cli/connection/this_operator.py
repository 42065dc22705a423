"""The operator's name for other operators."""

from __future__ import annotations

import getpass
import os
import socket


def this_operator() -> str:
    """Return user@machine, by which other operators know who this is."""
    return f"{_user()}@{socket.gethostname()}"


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # a user id without a name; the exception depends on Python's version
        return str(os.getuid())
