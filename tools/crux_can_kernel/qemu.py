"""A Debian kernel in an emulated machine: the way that asks nothing of the host's kernel, and the slowest.

The host's root file system comes in over 9p; a small initial RAM disk mounts it and changes into it.
"""

from __future__ import annotations

import os
import re
import shutil
import stat
import tempfile
from pathlib import Path

from crux_can_kernel.debian_kernel import debian_kernel, load_order, module_bytes
from crux_can_kernel.guest import run_guest, write_guest_files
from crux_can_kernel.job import Job, NoKernel

EMULATOR = "qemu-system-x86_64"
BOOT_S = {"kvm": 60.0, "tcg": 240.0}
TO_MOUNT = ("virtio_pci", "9p", "9pnet_virtio", "virtio_console")
FOR_CAN = ("can-raw", "can-bcm", "can-gw", "can-isotp", "vcan", "vxcan", "sch_netem")

_INIT = r"""#!/bin/busybox sh
/bin/busybox mkdir -p /proc /sys /dev /host
/bin/busybox mount -t devtmpfs devtmpfs /dev
for m in @BOOT_MODULES@; do /bin/busybox insmod /m/$m || echo "insmod $m failed"; done
/bin/busybox mount -t 9p -o trans=virtio,version=9p2000.L,msize=512000,cache=loose,access=any host /host || {
  echo "the host's files cannot be mounted"; /bin/busybox poweroff -f; }
/bin/busybox mount -t proc proc /host/proc
/bin/busybox mount -t sysfs sysfs /host/sys
/bin/busybox mount -t devtmpfs devtmpfs /host/dev
exec /bin/busybox switch_root /host /bin/sh @FIRST@
"""


def _cpio(entries: list[tuple[str, int, bytes]]) -> bytes:
    """An archive of (name, mode, content) in the format `newc`, which the kernel unpacks."""
    archive = bytearray()
    for number, (name, mode, content) in enumerate([*entries, ("TRAILER!!!", 0, b"")], start=1):
        path = name.encode() + b"\0"
        fields = (number, mode, 0, 0, 1, 0, len(content), 0, 0, 0, 0, len(path), 0)
        archive += b"070701" + b"".join(b"%08X" % field for field in fields) + path
        archive += b"\0" * (-len(archive) % 4) + content
        archive += b"\0" * (-len(archive) % 4)
    return bytes(archive)


def _accelerator() -> str:
    """kvm where it can work: /dev/kvm alone says little, it exists inside machines that cannot nest."""
    flags = Path("/proc/cpuinfo").read_text()
    works = os.access("/dev/kvm", os.R_OK | os.W_OK) and re.search(r"\b(vmx|svm)\b", flags) is not None
    return "kvm" if works else "tcg"


def _initial_disk(busybox: str, first: Path, boot_modules: list[Path]) -> bytes:
    names = [file.name.removesuffix(".xz") for file in boot_modules]
    init = _INIT.replace("@BOOT_MODULES@", " ".join(names)).replace("@FIRST@", str(first))
    entries = [(folder, stat.S_IFDIR | 0o755, b"") for folder in ("bin", "m", "host")]
    entries.append(("bin/busybox", stat.S_IFREG | 0o755, Path(busybox).read_bytes()))
    entries.append(("init", stat.S_IFREG | 0o755, init.encode()))
    entries += [
        (f"m/{name}", stat.S_IFREG | 0o644, module_bytes(file)) for name, file in zip(names, boot_modules, strict=True)
    ]
    return _cpio(entries)


def run(job: Job, state: Path) -> int:
    """Runs the job in an emulated machine. Raises NoKernel."""
    busybox = shutil.which("busybox")
    if shutil.which(EMULATOR) is None or busybox is None:
        raise NoKernel("needs an emulator (as root: apt-get install qemu-system-x86 busybox-static)")
    kernel = debian_kernel()
    boot_modules = load_order(kernel, TO_MOUNT)
    can_modules = [file for file in load_order(kernel, FOR_CAN) if file not in boot_modules]
    plain = []
    for file in can_modules:
        copy = state / file.name.removesuffix(".xz")
        copy.write_bytes(module_bytes(file))
        plain.append(str(copy))
    first = write_guest_files(state, job, plain, "/dev/vport?p1", "/dev/vport?p2")
    (state / "initrd").write_bytes(_initial_disk(busybox, first, boot_modules))
    accelerator = _accelerator()
    machine, processor = ("q35,hpet=off,vmport=off", "max") if accelerator == "tcg" else ("q35", "host")
    arguments = [
        *(EMULATOR, "-accel", accelerator, "-machine", machine, "-cpu", processor, "-smp", "1"),
        *("-m", f"{job.memory_MiB}M", "-nodefaults", "-no-user-config", "-display", "none", "-no-reboot"),
        *("-serial", f"file:{state}/console"),
        *("-fsdev", "local,id=host,path=/,security_model=none,multidevs=remap"),
        *("-device", "virtio-9p-pci,fsdev=host,mount_tag=host", "-device", "virtio-serial-pci"),
        *("-chardev", "file,id=o,path=/proc/self/fd/1", "-device", "virtserialport,chardev=o,nr=1"),
        *("-chardev", "file,id=e,path=/proc/self/fd/2", "-device", "virtserialport,chardev=e,nr=2"),
        *("-kernel", str(kernel.image), "-initrd", str(state / "initrd")),
        *("-append", "console=ttyS0 quiet panic=-1 oops=panic tsc=reliable no_timer_check random.trust_cpu=on"),
    ]
    return run_guest(state, job, arguments, dict(os.environ, TMPDIR=tempfile.gettempdir()), BOOT_S[accelerator])
