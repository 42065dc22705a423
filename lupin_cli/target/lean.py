"""Takes half of the time off `import paramiko`: what it brings along for the sake of one word each is loaded when it is used.

`invoke` runs the commands of `Match exec` lines of ~/.ssh/config. `importlib.metadata`, with all that reads mail, tells
paramiko its own version, which the folder beside it tells as well.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import ModuleType
from typing import Any


class PutOff(ModuleType):
    """Stands in for a module until something of it is asked for. importlib's own LazyLoader loads at the second `import`."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") and name != "__path__":
            raise AttributeError(name)  # of those who look at every module that there is
        if sys.modules.get(self.__name__) is self:
            del sys.modules[self.__name__]
        return getattr(importlib.import_module(self.__name__), name)


class _Metadata(PutOff):
    """`importlib.metadata`, but for the version of a package that is being imported."""

    def version(self, distribution_name: str) -> str:
        """As the real one; where there is any doubt, by it."""
        for place in getattr(sys.modules.get(distribution_name), "__path__", ()):
            told = [found.name for found in Path(place).parent.glob(f"{distribution_name}-*.dist-info")]
            if len(told) == 1:
                return told[0].removeprefix(f"{distribution_name}-").removesuffix(".dist-info")
        real: str = self.__getattr__("version")(distribution_name)
        return real


sys.modules.setdefault("invoke", PutOff("invoke"))
if "importlib.metadata" not in sys.modules:
    # The import that replaces it sets this name too.
    sys.modules["importlib.metadata"] = importlib.metadata = _Metadata("importlib.metadata")  # type: ignore[assignment]
