"""The firmware's ctypes bindings; in a checkout they live beside the headers they mirror, not on the Python path."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from types import ModuleType

from crux_tools.errors import WorkFailed
from crux_tools.paths import CHECKOUT, ROOT

PORTS = ROOT / "firmware" / "ports"


def binding(port: str, name: str) -> ModuleType:
    """Module `name` of a port."""
    if not CHECKOUT:
        return importlib.import_module(name)
    if name not in sys.modules:
        file = PORTS / port / f"{name}.py"
        spec = importlib.util.spec_from_file_location(name, file)
        if spec is None or spec.loader is None:
            raise WorkFailed(f"{file} cannot be loaded")
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    return sys.modules[name]
