"""The installed page: its files, and the version of its build."""

from __future__ import annotations

import hashlib
from pathlib import Path

from aiohttp import web

KEEP_FOREVER = "public, max-age=31536000, immutable"
_PAGE = Path(__file__).with_name("page")
_NOT_BUILT = "the page is not built in this checkout; build it with: make setup\n"


def add_page_files(application: web.Application) -> None:
    """Add the route of the page's files to an application."""
    if _PAGE.is_dir():
        application.router.add_static("/page/", _PAGE)


def index_response() -> web.FileResponse:
    """Return the response with the page itself. Raises HTTPServiceUnavailable."""
    if not (_PAGE / "index.html").is_file():
        raise web.HTTPServiceUnavailable(text=_NOT_BUILT)
    return web.FileResponse(_PAGE / "index.html")


def is_asset(path: str) -> bool:
    """Return whether a request's path is that of a file whose name holds a hash of its content: it never changes."""
    return path.startswith("/page/assets/") and (_PAGE / path.removeprefix("/page/")).is_file()


def page_version() -> str:
    """Return what tells this build of the page from others, so that an open page sees that it is outdated."""
    try:
        # It names all other files, whose names contain a hash of their content.
        return hashlib.sha256((_PAGE / "index.html").read_bytes()).hexdigest()[:16]
    except OSError:
        return ""
