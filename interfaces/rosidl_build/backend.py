"""The PEP 517 backend: setuptools, which builds the interface packages of this folder.

There is no setup.py, because colcon treats a folder with a setup.py as a Python package and does not search it for the ament
packages.
"""

from pathlib import Path

from setuptools import Extension, setup
from setuptools.build_meta import _BuildMetaBackend

from .command import EDITABLE_FOLDER, INTERFACES, BuildInterfaces
from .packages import discover, installed_definitions


class _Backend(_BuildMetaBackend):
    """Calls ``setup()`` directly, where setuptools would run a setup.py."""

    def run_setup(self, setup_script: str = "setup.py") -> None:  # noqa: ARG002 -- setuptools' signature
        packages = discover(INTERFACES)
        Path(EDITABLE_FOLDER).mkdir(parents=True, exist_ok=True)  # setuptools requires that its package folder exists
        setup(
            cmdclass={"build_ext": BuildInterfaces},
            ext_modules=[Extension(package.extension_module, sources=[]) for package in packages],
            package_dir={"": EDITABLE_FOLDER},
            packages=[],
            data_files=installed_definitions(packages),
        )


_backend = _Backend()
build_editable = _backend.build_editable
build_sdist = _backend.build_sdist
build_wheel = _backend.build_wheel
get_requires_for_build_editable = _backend.get_requires_for_build_editable
get_requires_for_build_sdist = _backend.get_requires_for_build_sdist
get_requires_for_build_wheel = _backend.get_requires_for_build_wheel
prepare_metadata_for_build_editable = _backend.prepare_metadata_for_build_editable
prepare_metadata_for_build_wheel = _backend.prepare_metadata_for_build_wheel
