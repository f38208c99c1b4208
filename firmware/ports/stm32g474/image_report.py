"""Prints flash, RAM and the deepest stack of node images, from arm-none-eabi-size and gcc's call graphs beside them."""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

_NODE = re.compile(r'node: \{ title: "([^"]+)" label: "[^"]*\\n(\d+) bytes \((\w+)')
_EDGE = re.compile(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')
_FLASH = re.compile(r"^FLASH\s+0x[0-9a-f]+\s+0x([0-9a-f]+)", re.MULTILINE)
EXCEPTION_FRAME_BYTES = 108  # what the core pushes with the floating-point registers, and its alignment
INTERRUPTS = ("board_on_systick", "drive_port_on_sample", "fdcan_on_interrupt")
POINTER = "__indirect_call"
FLASH_DRIVER = "/flash_port.c:"
FLASH_FUNCTIONS = tuple(f"{FLASH_DRIVER}{name}" for name in ("read", "write", "erase"))
WAITING = (":wait_for_flash",)
BOOT_STAGE = "crux_boot"


class CallGraph:
    """Functions with their own stack use and whom they call, from gcc -fcallgraph-info=su."""

    def __init__(self, files: list[Path]) -> None:
        self.frame_bytes: dict[str, int] = {}
        self.calls: dict[str, set[str]] = {}
        for file in files:
            text = file.read_text(encoding="utf-8")
            for title, size, kind in _NODE.findall(text):
                if kind != "static":
                    raise ValueError(f"{title}: its stack use is {kind}, not known before it runs")
                self.frame_bytes[title] = int(size)
            for source, target in _EDGE.findall(text):
                for called in self._through_pointer(source) if target == POINTER else [target]:
                    self.calls.setdefault(source, set()).add(called)
        for pointer, functions in (("(flash)", FLASH_FUNCTIONS), ("(while busy)", WAITING)):
            self.calls[pointer] = {title for title in self.frame_bytes if title.endswith(functions)}

    @staticmethod
    def _through_pointer(source: str) -> list[str]:
        """Whom a function calls through a pointer: the flash's driver the node, while it waits; others the driver."""
        return ["(while busy)" if FLASH_DRIVER in source else "(flash)"]

    def deepest(self, start: str) -> int:
        """Stack [B] of the deepest chain of calls from `start`. Library functions count 0; recursion is an error."""

        @cache
        def depth(name: str) -> int:
            if name in on_the_way:
                raise ValueError(f"recursion through {name}")
            on_the_way.add(name)
            below = max((depth(target) for target in self.calls.get(name, ())), default=0)
            on_the_way.remove(name)
            return self.frame_bytes.get(name, 0) + below

        on_the_way: set[str] = set()
        return depth(start)


def flash_bytes(image: Path) -> int:
    """Room for a program, from the linker's map beside it."""
    found = _FLASH.search(image.with_suffix(".map").read_text("utf-8"))
    if not found:
        raise ValueError(f"no memory FLASH in the map of {image}")
    return int(found[1], 16)


def describe(image: Path, size_tool: str) -> str:
    """One line: sizes and stack of an image."""
    listing = subprocess.run([size_tool, str(image)], check=True, capture_output=True, text=True).stdout
    text, data, bss = (int(number) for number in listing.splitlines()[1].split()[:3])
    own_main = f"{image.stem.split('_')[1]}_main.c"
    graphs = [p for p in image.parent.glob("*.ci") if not p.name.endswith("_main.c.ci") or p.name == f"{own_main}.ci"]
    if not graphs:
        raise FileNotFoundError(f"no call graphs (*.ci) beside {image}")
    graph = CallGraph(graphs)
    handlers = INTERRUPTS[:1] if image.stem == BOOT_STAGE else INTERRUPTS
    interrupts = sum(graph.deepest(name) + EXCEPTION_FRAME_BYTES for name in handlers)
    room = flash_bytes(image)
    return (
        f"{image.name}: flash {text + data} of {room} B, RAM {data + bss} B, stack {graph.deepest('main')} B"
        f" + {interrupts} B for interrupts (library functions not counted)"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("images", nargs="+", type=Path)
    parser.add_argument("--size", default="arm-none-eabi-size", help="size tool of the cross compiler")
    options = parser.parse_args()
    try:
        for image in options.images:
            print(describe(image, options.size))
    except (OSError, ValueError, subprocess.CalledProcessError) as error:
        print(f"image_report: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
