"""The ctypes binding of the firmware's nodes; in a checkout it lives beside the header it mirrors."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from types import ModuleType

from crux_tools.errors import WorkFailed
from crux_tools.paths import CHECKOUT, ROOT

NAME = "crux_nodes"
FILE = ROOT / "firmware" / "ports" / "host" / f"{NAME}.py"


def crux_nodes() -> ModuleType:
    """The module of that name, which is not on the Python path of a checkout."""
    if not CHECKOUT:
        return importlib.import_module(NAME)
    if NAME not in sys.modules:
        spec = importlib.util.spec_from_file_location(NAME, FILE)
        if spec is None or spec.loader is None:
            raise WorkFailed(f"{FILE} cannot be loaded")
        module = importlib.util.module_from_spec(spec)
        sys.modules[NAME] = module
        spec.loader.exec_module(module)
    return sys.modules[NAME]
