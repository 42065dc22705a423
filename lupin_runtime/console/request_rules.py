"""Which requests port 8090 accepts from anyone, judged by their `Host` and `Origin` headers and by their encryption."""

from __future__ import annotations

import ipaddress
import socket

from aiohttp import web

_SAFE_METHODS = ("GET", "HEAD", "OPTIONS")


def check_host(request: web.Request) -> None:
    """Refuse host names that are not this computer's: another site may have a name that resolves to this address."""
    name = host_name(request.host)
    if not (_is_address(name) or name in _own_names() or name.endswith(".localhost")):
        raise web.HTTPMisdirectedRequest(text=f"this server is not {name[:100]}\n")


def check_origin(request: web.Request) -> None:
    """Refuse WebSockets, and requests that may change something, from pages of other origins."""
    origin = request.headers.get("Origin")
    if origin is not None and origin != f"{request.scheme}://{request.host}":
        raise web.HTTPForbidden(text=f"pages of {origin[:200]} may not use this server\n")
    unsafe = request.method not in _SAFE_METHODS or request.headers.get("Upgrade", "").lower() == "websocket"
    if unsafe and request.headers.get("Sec-Fetch-Site", "same-origin") not in ("same-origin", "none"):
        raise web.HTTPForbidden(text="pages of other sites may not use this server\n")


def opens_page(request: web.Request) -> bool:
    """Return whether a browser's user opens a page with this request: a page of another site can send it, too, unseen."""
    site, destination = request.headers.get("Sec-Fetch-Site", "none"), request.headers.get("Sec-Fetch-Dest", "document")
    return site in ("none", "same-origin") and destination == "document" and "text/html" in request.headers.get("Accept", "")


def check_encryption(request: web.Request) -> None:
    """Redirect browsers on other computers to HTTPS: a code or a cookie must not cross the network unencrypted."""
    if request.secure or is_loopback(request):
        return
    if request.method in _SAFE_METHODS and "Upgrade" not in request.headers:
        raise web.HTTPPermanentRedirect(f"https://{request.host}{request.path_qs}")
    raise web.HTTPForbidden(text="use HTTPS\n")


def is_loopback(request: web.Request) -> bool:
    """Return whether a request comes from this computer itself and did not pass through a proxy."""
    forwarded = any(header in request.headers for header in ("X-Forwarded-For", "Forwarded", "Via"))
    remote = (request.remote or "").removeprefix("::ffff:")
    return not forwarded and _is_address(remote) and ipaddress.ip_address(remote).is_loopback


def device_kind(user_agent: str) -> str:
    """Return the kind of device that a browser's `User-Agent` indicates: phone, tablet or computer."""
    if "iPad" in user_agent or ("Android" in user_agent and "Mobile" not in user_agent):
        return "tablet"
    return "phone" if "Mobile" in user_agent or "iPhone" in user_agent else "computer"


def host_name(host: str) -> str:
    """Return the name or address in a `Host` header or in a URL's authority, without its port."""
    if host.startswith("["):
        return host[1:].split("]", 1)[0].lower()
    return (host.rsplit(":", 1)[0] if host.count(":") == 1 else host).lower()


def _own_names() -> tuple[str, ...]:
    name = socket.gethostname().lower()
    short = name.split(".", 1)[0]
    return ("localhost", name, short, f"{short}.local")


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name.split("%", 1)[0])
    except ValueError:
        return False
    return True
