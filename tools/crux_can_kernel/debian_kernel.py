"""A Debian kernel package, unpacked into the user's cache, and its modules in load order."""

from __future__ import annotations

import lzma
import re
import subprocess
import tempfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from crux_can_kernel.job import NoKernel
from crux_can_kernel.uml_kernel import cache

META_PACKAGE = "linux-image-amd64"


@dataclass(frozen=True)
class DebianKernel:
    """An unpacked kernel package."""

    folder: Path

    @cached_property
    def image(self) -> Path:
        """The kernel itself."""
        images = sorted((self.folder / "boot").glob("vmlinuz-*"))
        if not images:
            raise NoKernel(f"{self.folder} holds no kernel")
        return images[-1]

    @cached_property
    def modules(self) -> dict[str, Path]:
        """Module files by name, '_' for '-'."""
        files = self.folder.glob("**/modules/*/kernel/**/*.ko*")
        return {file.name.split(".ko")[0].replace("-", "_"): file for file in files}

    @cached_property
    def built_in(self) -> set[str]:
        """Names of what needs no loading."""
        return {
            Path(line).name.split(".ko")[0].replace("-", "_")
            for file in self.folder.glob("**/modules/*/modules.builtin")
            for line in file.read_text().split()
        }


def _call(arguments: list[str], folder: Path) -> str:
    try:
        done = subprocess.run(arguments, cwd=folder, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise NoKernel(f"not a Debian system: there is no {arguments[0]}") from None
    if done.returncode != 0:
        raise NoKernel(f"{' '.join(arguments)}: {done.stderr.strip() or f'status {done.returncode}'}")
    return done.stdout


def debian_kernel() -> DebianKernel:
    """The kernel that Debian installs at present; downloaded when it is missing. Raises NoKernel."""
    wanted = re.search(r"Depends: (linux-image-\S+)", _call(["apt-cache", "depends", META_PACKAGE], Path("/")))
    if wanted is None:
        raise NoKernel(f"apt knows no {META_PACKAGE} (as root: apt-get update)")
    package = wanted.group(1)
    folder = cache() / package
    if not folder.exists():
        cache().mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="download-", dir=cache()) as name:
            work = Path(name)
            _call(["apt-get", "download", "-q", package], work)
            _call(["dpkg-deb", "-x", next(work.glob("*.deb")).name, "unpacked"], work)
            (work / "unpacked").rename(folder)
    return DebianKernel(folder)


def module_bytes(file: Path) -> bytes:
    """A module, unpacked if it is compressed."""
    data = file.read_bytes()
    return lzma.decompress(data) if file.suffix == ".xz" else data


def load_order(kernel: DebianKernel, names: tuple[str, ...]) -> list[Path]:
    """Files of the modules and of all they depend on, in an order in which they load. Raises NoKernel."""
    order: list[Path] = []

    def add(name: str) -> None:
        key = name.replace("-", "_")
        file = kernel.modules.get(key)
        if file is None:
            if key not in kernel.built_in:
                raise NoKernel(f"{kernel.folder.name} has no module {name}")
            return
        if file in order:
            return
        depends = re.search(rb"\0depends=([^\0]*)\0", module_bytes(file))
        for needed in depends.group(1).decode().split(",") if depends else []:
            if needed:
                add(needed)
        order.append(file)

    for name in names:
        add(name)
    return order
