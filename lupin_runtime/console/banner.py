"""What `lupin up` prints about the console: its URLs, a QR code for a phone, and how the robot is discovered."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TextIO

from lupin_runtime.console.host_addresses import HostAddresses
from lupin_runtime.stack.dds import DiscoveryMode

QUIET_ZONE = 4  # modules around the code, ISO/IEC 18004
_HALF_BLOCKS = (" ", "▄", "▀", "█")  # indexed by 2 * upper module + lower module
_BLACK_ON_WHITE, _RESET = "\x1b[38;5;16;48;5;231m", "\x1b[0m"  # from the 256-color palette, which themes do not change
_MIN_COLUMNS = 24


@dataclass(frozen=True)
class Screen:
    """What the output can show. `interactive` means that a person reads it and that it is not stored, as in a log file."""

    columns: int
    interactive: bool
    unicode: bool
    color: bool


def screen_of(stream: TextIO, environment: Mapping[str, str]) -> Screen:
    """Describe an output stream.

    The terminal's character set is taken from the locale, because Python may write UTF-8 to any terminal (PEP 540).
    """
    interactive = stream.isatty()
    columns = 80
    if interactive:
        try:
            columns = os.get_terminal_size(stream.fileno()).columns or columns  # 0 on a serial line of unknown width
        except OSError:
            interactive = False
    locale = next((value for name in ("LC_ALL", "LC_CTYPE", "LANG") if (value := environment.get(name))), "UTF-8")
    unicode = all(_is_utf8(name) for name in (locale.rpartition(".")[2], stream.encoding or ""))
    color = interactive and not environment.get("NO_COLOR") and environment.get("TERM") != "dumb"
    return Screen(columns, interactive, unicode, color)


def _is_utf8(name: str) -> bool:
    return name.partition("@")[0].replace("-", "").lower() == "utf8"


@dataclass(frozen=True)
class ConsoleUrls:
    """The console's URLs for other devices and for this machine, each in order of preference."""

    network: tuple[str, ...]
    local: tuple[str, ...]


def console_urls(reachable: HostAddresses, *, https_port: int | None, http_port: int | None) -> ConsoleUrls:
    """Return the URLs of a console that serves HTTPS, HTTP or both.

    For other devices HTTPS comes first, because browsers give only secure pages access to a microphone; for this machine HTTP,
    which counts as secure on localhost and needs no certificate.
    """
    addresses = [f"[{address}]" if address.version == 6 else str(address) for address in reachable.addresses]
    hosts = [*addresses, *(name for name in reachable.names if name.endswith(".local"))]
    https = [_url("https", host, https_port) for host in hosts if https_port is not None]
    http = [_url("http", host, http_port) for host in hosts if http_port is not None]
    ports = (("http", http_port), ("https", https_port))
    local = [_url(scheme, "localhost", port) for scheme, port in ports if port is not None]
    return ConsoleUrls((*https, *http), tuple(local))


def _url(scheme: str, host: str, port: int) -> str:
    return f"{scheme}://{host}" + ("" if port == {"http": 80, "https": 443}[scheme] else f":{port}")


def banner(
    urls: ConsoleUrls,
    mode: DiscoveryMode,
    screen: Screen,
    *,
    pairing_url: str | None = None,
    notes: Iterable[str] = (),
) -> str:
    """Return the banner's text, with a final newline.

    `pairing_url` contains a one-time code, preferably in its fragment, which browsers do not send and pages can remove. It
    replaces the first network URL in the QR code, and is shown only on interactive screens, so that no log contains it.
    `notes` are sentences such as those in `Certificates.notes`.
    """
    rows: list[tuple[str, Sequence[str]]] = [("network", urls.network), ("this machine", urls.local)]
    rows.append(("DDS", [mode.sentence]))
    if pairing_url is not None and screen.interactive:
        rows.append(("pair a device", [pairing_url]))
    rows = [(label, tuple(map(_printable, values))) for label, values in rows if values]
    lines = ["Console", *_table(rows, screen.columns)]
    for text in (mode.warning, *notes):
        lines += _paragraph(_printable(text), screen.columns)
    target = pairing_url or next(iter(urls.network), None)
    if target is not None and screen.interactive and screen.unicode:
        lines += ["", *qr_lines(target, screen)]
    return "\n".join(line if screen.unicode else line.encode("ascii", "replace").decode() for line in lines) + "\n"


def _table(rows: Sequence[tuple[str, Sequence[str]]], columns: int) -> list[str]:
    """Lay out each label beside its values, or above them if the screen is too narrow, so that no URL is wrapped."""
    width = max(len(label) for label, _ in rows) + 2
    if 2 + width + max(len(value) for _, values in rows for value in values) > columns:
        return [line for label, values in rows for line in (f"  {label}", *values)]
    return [f"  {label if index == 0 else '':{width}}{value}" for label, values in rows for index, value in enumerate(values)]


def _paragraph(text: str, columns: int) -> list[str]:
    if not text:
        return []
    return textwrap.wrap(
        text,
        max(columns, _MIN_COLUMNS),
        initial_indent="  ! ",
        subsequent_indent="    ",
        break_long_words=False,
        break_on_hyphens=False,
    )


def _printable(text: str) -> str:
    """Replace control characters, which environment variables and host names may contain and a terminal would obey."""
    return "".join(character if character.isprintable() else "\N{REPLACEMENT CHARACTER}" for character in text)


def qr_lines(text: str, screen: Screen) -> list[str]:
    """Draw the QR code of `text` in half blocks, two rows of modules per line; or a line that says that it does not fit.

    With color it is black on white, whatever the terminal's theme. Without, the terminal's background is assumed to be dark.
    """
    import segno

    rows = [list(row) for row in segno.make_qr(text, error="l").matrix_iter(border=QUIET_ZONE)]
    if len(rows[0]) > screen.columns:
        return [f"(the QR code needs {len(rows[0])} columns)"]
    light = 0 if screen.color else 1
    rows = [[module ^ light for module in row] for row in rows]
    if len(rows) % 2:
        rows.append([light] * len(rows[0]))
    lines = ["".join(_HALF_BLOCKS[2 * up + down] for up, down in zip(*pair)) for pair in zip(rows[::2], rows[1::2])]
    return [f"{_BLACK_ON_WHITE}{line}{_RESET}" for line in lines] if screen.color else lines
