"""Finds the interface packages of a folder, with their definitions, in the order of their dependencies."""

import re
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from xml.etree import ElementTree

KINDS = ("msg", "srv", "action")


@dataclass(frozen=True)
class InterfacePackage:
    """One ament interface package: a folder with a package.xml and ``msg/``, ``srv/`` or ``action/``."""

    name: str
    folder: Path
    definitions: tuple[Path, ...]
    """Relative to ``folder``, for example ``msg/TagReading.msg``."""
    depends: frozenset[str]
    """Packages named by ``<depend>`` in package.xml."""

    @property
    def extension_module(self) -> str:
        """Dotted name of the compiled module that ``rosidl_generator_py`` imports for this package."""
        return f"{self.name}.{self.name}_s__rosidl_typesupport_c"


def read_package(folder: Path) -> InterfacePackage:
    """Read the ament interface package in ``folder``.

    Raises SystemExit if the name in package.xml differs from the folder's.
    """
    manifest = ElementTree.parse(folder / "package.xml").getroot()  # noqa: S314 -- our own files
    name = manifest.findtext("name", "").strip()
    if name != folder.name:
        raise SystemExit(f"{folder / 'package.xml'}: expected <name>{folder.name}</name>, found <name>{name}</name>")
    return InterfacePackage(
        name=name,
        folder=folder,
        definitions=tuple(sorted(p.relative_to(folder) for kind in KINDS for p in (folder / kind).glob(f"*.{kind}"))),
        depends=frozenset(e.text.strip() for e in manifest.iter("depend") if e.text),
    )


def discover(root: Path) -> list[InterfacePackage]:
    """All interface packages directly below ``root``, sorted by dependency. Raises SystemExit for a circle."""
    packages = {p.name: p for p in (read_package(m.parent) for m in sorted(root.glob("*/package.xml")))}
    graph = {name: sorted(p.depends & packages.keys()) for name, p in sorted(packages.items())}
    try:
        return [packages[name] for name in TopologicalSorter(graph).static_order()]
    except CycleError as error:
        raise SystemExit(f"{root}: interface packages depend on each other in a circle: {' → '.join(error.args[1])}") from None


def referenced_packages(package: InterfacePackage) -> set[str]:
    """Packages whose types the definitions of ``package`` use, found in their text."""
    used = set()
    for definition in package.definitions:
        for line in (package.folder / definition).read_text(encoding="utf-8").splitlines():
            if match := re.match(r"\s*([a-z]\w*)/\w+", line.split("#", 1)[0]):
                used.add(match[1])
    return used - {package.name}


def installed_definitions(packages: list[InterfacePackage]) -> list[tuple[str, list[str]]]:
    """The wheel's ``data_files``: definitions, package.xml and CMakeLists.txt in ``share/<package>/``, as in ROS packages.

    Recorders and introspection tools read the definitions there.
    """
    files: dict[str, list[str]] = {}
    for package in packages:
        for path in (Path("package.xml"), Path("CMakeLists.txt"), *package.definitions):
            target = (Path("share") / package.name / path).parent
            files.setdefault(str(target), []).append(str(Path(package.name) / path))
    return sorted(files.items())
