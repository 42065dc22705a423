"""Tells setuptools that the interface packages beside this file are generated and compiled by ``rosidl_build``."""

import sys
from pathlib import Path

from setuptools import Extension, setup

INTERFACES = Path(__file__).resolve().parent
sys.path.insert(0, str(INTERFACES))  # a build backend does not put the project's own folder on the path

from rosidl_build.command import EDITABLE_FOLDER, BuildInterfaces  # noqa: E402
from rosidl_build.packages import discover, installed_definitions  # noqa: E402

packages = discover(INTERFACES)
(INTERFACES / EDITABLE_FOLDER).mkdir(parents=True, exist_ok=True)  # setuptools wants its package folder to exist

setup(
    cmdclass={"build_ext": BuildInterfaces},
    ext_modules=[Extension(package.extension_module, sources=[]) for package in packages],
    package_dir={"": EDITABLE_FOLDER},
    packages=[],
    data_files=installed_definitions(packages),
)
