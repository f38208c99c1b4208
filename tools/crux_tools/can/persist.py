"""Files by which udev and systemd-networkd set the robot's buses up at every boot, named by adapter."""

from __future__ import annotations

from pathlib import Path

from crux_contracts.robot import Robot

from crux_tools.can.interfaces import QUEUE_FRAMES, RESTART_MS, SAMPLE_POINT, Interface
from crux_tools.errors import WorkFailed

RULES = "etc/udev/rules.d/70-crux-can.rules"
NETWORK = "etc/systemd/network/70-crux-{}.network"
NAMES = ("canLF", "canRF", "canLR", "canRR")  # none that the kernel gives: it could not swap can0 and can1
RELOAD = "udevadm control --reload; systemctl enable --now systemd-networkd; networkctl reload"


def adapter_of(name: str, system: Path = Path("/sys")) -> tuple[str, str]:
    """Where an interface's adapter is plugged in (sysfs name of its parent device), and which of its ports it is, as
    udev's KERNELS and ATTR{dev_port} take them. Raises WorkFailed."""
    folder = system / "class" / "net" / name
    try:
        device = (folder / "device").resolve(strict=True).name
        port, number = ((folder / file).read_text(encoding="utf-8").strip() for file in ("dev_port", "dev_id"))
    except OSError:
        raise WorkFailed(f"{name} has no adapter: a virtual interface is not kept over a boot") from None
    return device, f'ATTR{{dev_id}}=="{number}", ATTR{{dev_port}}=="{port}"'


def rule(name: str, device: str, port: str) -> str:
    """A line for udev: the port of that adapter gets that name, and a queue that plays no old commands."""
    match = f'ACTION=="add", SUBSYSTEM=="net", KERNELS=="{device}", {port}'
    return f'{match}, NAME="{name}", ATTR{{tx_queue_len}}="{QUEUE_FRAMES}"'


def network(name: str, robot: Robot) -> str:
    """What systemd-networkd sets, the same as `set_up_commands`."""
    point = f"{100 * SAMPLE_POINT:g}%"
    return (
        f"# Written by `crux can up --persist` for the buses of {robot.name}.\n"
        f"[Match]\nName={name}\n\n"
        f"[Network]\nLinkLocalAddressing=no\n\n"
        f"[CAN]\nBitRate={robot.can.bit_rate}\nSamplePoint={point}\n"
        f"FDMode=yes\nDataBitRate={robot.can.data_bit_rate}\nDataSamplePoint={point}\n"
        f"RestartSec={RESTART_MS}ms\nBusErrorReporting=yes\n"
    )


def files_of(interfaces: list[Interface], robot: Robot, system: Path = Path("/sys")) -> dict[str, str]:
    """Contents by path below the root folder, for the interfaces of LF, RF, LR and RR. Raises WorkFailed."""
    if len(interfaces) != len(NAMES):
        raise WorkFailed(f"--persist names the buses of LF, RF, LR and RR: four interfaces, not {len(interfaces)}")
    named = list(zip(NAMES, interfaces, strict=True))
    rules = [rule(name, *adapter_of(one.name, system)) for name, one in named]
    files = {RULES: "\n".join(["# Written by `crux can up --persist`.", *rules]) + "\n"}
    return files | {NETWORK.format(name): network(name, robot) for name in NAMES}


def write(files: dict[str, str], root: Path = Path("/")) -> None:
    """Raises WorkFailed."""
    for name, text in files.items():
        path = root / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        except OSError as error:
            raise WorkFailed(f"{path}: {error.strerror}") from None
