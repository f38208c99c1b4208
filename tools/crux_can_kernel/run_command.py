"""`crux can run`: a command under a kernel that has SocketCAN; `crux can kernel`: ours, built ahead of time."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from typing import Any

from crux_tools.arguments import positive, taught, whole
from crux_tools.errors import UsageError, WorkFailed
from crux_tools.output import add_json_option, note, print_json

from crux_can_kernel.job import DEFAULT_INTERFACE, DEFAULT_TIMEOUT_S, NO_KERNEL, Job, NoKernel

BACKENDS = ("native", "uml", "qemu")
VIRTUAL_TIME_BACKEND = "uml"
LONGEST_NAME = 15  # of an interface, IFNAMSIZ - 1
_DESCRIPTION = """Runs CMD under a Linux kernel with SocketCAN, on this machine's own files, environment and working
directory, with virtual CAN FD interfaces of its own. Standard output, standard error and the exit status pass through;
standard input is empty. No network and no hardware virtualisation are needed."""
_EPILOG = """kernels, tried in this order unless --backend names one:
  native  this kernel, where it has CAN sockets: a network namespace with vcan
  uml     user-mode Linux, our own build (crux can kernel); one processor, starts in about 2 s
  qemu    a Debian kernel in an emulated machine; starts in about 15 s
With --virtual-time (uml alone) only waiting takes time, however long the machine computes: no cycle is ever late, and
two runs are the same.

exit status: the command's own (128+n after signal n); 124 it took longer than --timeout; 125 no kernel could be had

examples:
  crux can run -- candump -n 1 vcan0
  crux can run --virtual-time -i can0,can1,can2,can3 -- crux climb plan.mcap -o log.mcap --bus socketcan"""


def _interfaces(text: str) -> tuple[str, ...]:
    names = tuple(text.split(","))
    for name in names:
        if not re.fullmatch(rf"[A-Za-z][\w.-]{{0,{LONGEST_NAME - 1}}}", name):
            raise argparse.ArgumentTypeError(
                f"'{name}' is no interface name: right are at most {LONGEST_NAME} letters, digits, '_', '.' and '-'"
            )
    if len(set(names)) != len(names):
        raise argparse.ArgumentTypeError(f"'{text}' names an interface twice")
    return names


def add_run(actions: Any) -> None:
    """crux can run."""
    parser = actions.add_parser(
        "run",
        help="run a command under a kernel with SocketCAN",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        usage="crux can run [options] -- CMD [ARG ...]",
    )
    parser.add_argument("--backend", choices=("auto", *BACKENDS), default="auto", help="which kernel (default: auto)")
    parser.add_argument(
        "-i",
        "--interfaces",
        type=_interfaces,
        default=(DEFAULT_INTERFACE,),
        metavar="NAMES",
        help=f"virtual interfaces to make, by comma (default: {DEFAULT_INTERFACE})",
    )
    parser.add_argument(
        "--timeout",
        type=positive,
        default=DEFAULT_TIMEOUT_S,
        metavar="S",
        help="for the command (default: %(default)g)",
    )
    parser.add_argument("--virtual-time", action="store_true", help="time jumps on when all programs wait (uml)")
    parser.add_argument(
        "--memory", type=whole(1), default=1024, metavar="MIB", help="of a guest kernel (default: %(default)s MiB)"
    )
    parser.add_argument("-v", "--verbose", action="store_true", help="say which kernel it is and how long it took")
    parser.add_argument("cmd", nargs=argparse.REMAINDER, metavar="CMD", help="the command and its arguments")
    parser.set_defaults(action=run)


def add_kernel(actions: Any) -> None:
    """crux can kernel."""
    parser = actions.add_parser(
        "kernel",
        help="build the user-mode kernel if it is missing",
        **taught(
            "Builds the user-mode kernel from Debian's source into ~/.cache/crux/kernels, if it is missing.",
            "crux can kernel",
        ),
    )
    add_json_option(parser)
    parser.set_defaults(action=run_kernel)


def _job(options: argparse.Namespace) -> Job:
    command = options.cmd[1:] if options.cmd[:1] == ["--"] else options.cmd
    if not command:
        raise UsageError("no command; right is: crux can run [options] -- CMD [ARG ...]")
    if options.virtual_time and options.backend not in {"auto", VIRTUAL_TIME_BACKEND}:
        raise UsageError(f"--virtual-time: only the back-end {VIRTUAL_TIME_BACKEND} has it, not {options.backend}")
    return Job(
        command=tuple(command),
        interfaces=options.interfaces,
        timeout_s=options.timeout,
        virtual_time=options.virtual_time,
        memory_MiB=options.memory,
        verbose=options.verbose,
    )


def _runners() -> dict[str, Callable[..., int]]:
    from crux_can_kernel import native, qemu, uml

    return {"native": native.run, "uml": uml.run, "qemu": qemu.run}


def _order(options: argparse.Namespace) -> list[str]:
    from crux_can_kernel import native

    if options.backend != "auto":
        return [options.backend]
    if options.virtual_time:
        return [VIRTUAL_TIME_BACKEND]
    return [name for name in BACKENDS if name != "native" or native.available()]


def run(options: argparse.Namespace) -> int:
    """The command's exit status, 124 or 125."""
    from crux_can_kernel.guest import state_folder

    job, runners = _job(options), _runners()
    for name in _order(options):
        with state_folder() as state:
            try:
                if job.verbose:
                    note(f"crux can run: kernel {name}")
                return runners[name](job, state)
            except NoKernel as error:
                note(f"crux can run: {name}: {error}")
                if (state / "booted").exists():  # the command may have begun: never run it twice
                    break
    return NO_KERNEL


def run_kernel(options: argparse.Namespace) -> int:
    """Exit status 0 when the kernel is there."""
    from crux_can_kernel.uml_kernel import kernel

    try:
        path = kernel()
    except NoKernel as error:
        raise WorkFailed(f"user-mode kernel: {error}") from error
    if options.json:
        print_json({"ok": True, "kernel": str(path)})
    else:
        note(f"user-mode kernel: {path}")
    return 0
