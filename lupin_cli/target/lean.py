"""Takes half of the time off `import paramiko`: a task runner that it brings along for one word of ~/.ssh/config.

That is `invoke`, which runs the commands of `Match exec` lines. It is loaded where such a line is met, and not at every start.
"""

from __future__ import annotations

import importlib
import sys
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


sys.modules.setdefault("invoke", PutOff("invoke"))
