"""The interpreter that runs modules of this installation as processes of their own."""

from __future__ import annotations

import sys

# -P: modules come from the installation, never from the folder in which a person happens to be. Python 3.10, which a robot may
# have, does not know it; the robot's services start in /, where only root may write.
PYTHON = (sys.executable, "-P") if sys.version_info >= (3, 11) else (sys.executable,)
