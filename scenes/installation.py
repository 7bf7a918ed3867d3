"""Locations of the installed package: its folder, and the folder that Python imports it from."""

from __future__ import annotations

from pathlib import Path

import pbrnet

PACKAGE = Path(pbrnet.__file__).parent  # the folder `pbrnet`; in a checkout it holds links
IMPORT_FOLDER = PACKAGE.parent  # the entry of `sys.path` that makes `import pbrnet` work
