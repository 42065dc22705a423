"""Sends requests to the motor board on its serial port, and prints what arrives, in hexadecimal.

Usage: PORT REQUESTS. This file runs on the robot, as `python3 -c`: it needs only Python 3.8, and imports nothing of Lupin. It
sends nothing while another process has the port open, or may have it open: it must be root to see the files of all others.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import stat
import sys
import termios
import time
from collections.abc import Callable, Iterator
from pathlib import Path

# The firmware forgets half a request after 0.1 s. What the last program sent of one must not be completed by these requests:
# it may be one for a motor.
PAUSE_S = 0.25
LISTEN_S = 4.0  # the vendor's driver waits for 2 s, and a late answer must differ from none
QUIET_S = 0.5  # a board that has answered and then sends nothing is done
WRITE_S = 1.0
MAX_BYTES = 4096


class Refused(Exception):
    """Nothing was sent; the message says why."""


def find_holders(port: str) -> Iterator[str]:
    """Yield `PID NAME` of each other process that has the port open. Raises Refused if that cannot be seen."""
    status = Path(port).stat()
    if not stat.S_ISCHR(status.st_mode):
        raise Refused("it is no device")
    for process in Path("/proc").glob("[0-9]*"):
        if int(process.name) == os.getpid():
            continue
        try:
            opened = list((process / "fd").iterdir())
        except PermissionError:
            raise Refused("only root can see whether another process has the port open") from None
        except OSError:
            continue  # it has ended
        for file in opened:
            with contextlib.suppress(OSError):
                if file.stat().st_rdev == status.st_rdev:
                    yield f"{process.name} {(process / 'comm').read_text(errors='replace').strip()}"
                    break


@contextlib.contextmanager
def exclusive_port(port: str) -> Iterator[int]:
    """Open a port that nobody else has open, so that nobody else can open it. Raises Refused.

    The baud rate is never 1200, which would restart a Pico in its boot loader, and the modem lines stay as they are on close.
    """
    try:
        file = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError as error:
        raise Refused(f"could not open the port: {error.strerror}") from None
    try:
        fcntl.ioctl(file, termios.TIOCEXCL)
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        before = termios.tcgetattr(file)
        control = termios.CS8 | termios.CREAD | termios.CLOCAL
        termios.tcsetattr(file, termios.TCSANOW, [0, 0, control, 0, termios.B115200, termios.B115200, before[6]])
        try:
            yield file
        finally:
            before[2] &= ~termios.HUPCL
            with contextlib.suppress(termios.error):  # the board may have been unplugged
                termios.tcflush(file, termios.TCOFLUSH)  # close would wait 30 s for what a board does not take
                termios.tcsetattr(file, termios.TCSANOW, before)
    except (OSError, termios.error) as error:
        raise Refused(f"the port cannot be used alone: {error.args[-1]}") from None
    finally:
        with contextlib.suppress(OSError):
            fcntl.ioctl(file, termios.TIOCNXCL)
        os.close(file)


def listen(file: int, seconds: float, is_done: Callable[[float], bool], started: float) -> int:
    """Print what arrives until it is done, at most for so long; `is_done` gets the seconds without a byte. Return its size."""
    size, last, end = 0, time.monotonic(), time.monotonic() + seconds
    while size < MAX_BYTES and time.monotonic() < end:
        if select.select([file], [], [], 0.02)[0]:
            data = os.read(file, MAX_BYTES - size)
            if not data:
                raise OSError(0, "the board left the bus")
            last = time.monotonic()
            size += len(data)
            print(f"{last - started:.3f} {data.hex()}")
        elif size and is_done(time.monotonic() - last):
            break
    return size


def send(file: int, requests: bytes) -> None:
    """Write the requests. Raises OSError if the port does not take them in time."""
    end = time.monotonic() + WRITE_S
    while requests:
        if not select.select([], [file], [], max(0.0, end - time.monotonic()))[1]:
            raise OSError(0, f"the port took no data for {WRITE_S:g} s")
        requests = requests[os.write(file, requests) :]


def ask(port: str, requests: bytes) -> None:
    """Print the sections of one port: who holds it, why nothing was sent, or what was received and why that ended early."""
    print(f"@@ asked {port}")
    holders = list(find_holders(port))
    with exclusive_port(port) if not holders else contextlib.nullcontext(-1) as file:
        holders = holders or list(find_holders(port))  # another program may have opened it at the same time
        if holders:
            print("@@ held", *holders, sep="\n")
            return
        print("@@ received")
        try:
            until = time.monotonic() + PAUSE_S
            while time.monotonic() < until:  # a board that floods must not shorten it
                listen(file, until - time.monotonic(), lambda _: False, until)
            started = time.monotonic()
            send(file, requests)
            listen(file, LISTEN_S, lambda quiet_s: quiet_s > QUIET_S, started)
        except OSError as error:
            print(f"@@ failed\n{error.strerror}")


def main(port: str, requests: str) -> None:
    """Ask one port, and print why if that is impossible."""
    try:
        ask(port, bytes.fromhex(requests))
    except (Refused, OSError) as error:
        print(f"@@ refused\n{error}")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
