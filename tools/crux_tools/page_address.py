"""Where a page that a command serves is listened for."""

from __future__ import annotations

import argparse
import contextlib
import errno
import fcntl
import socket
import struct

from crux_tools.errors import UsageError

DEFAULT_PORT = 8737
SIOCGIFADDR = 0x8915  # of linux/sockios.h: the IPv4 address of an interface


def port(text: str) -> int:
    """A port, as an argument. Raises argparse.ArgumentTypeError."""
    number = int(text) if text.isdigit() else -1
    if not 0 <= number <= 65535:
        raise argparse.ArgumentTypeError(f"'{text}' is not a port: 1 … 65535, or 0 for any free one")
    return number


def add_address(parser: argparse.ArgumentParser) -> None:
    """--host and --port."""
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        help="address the view is served on (default: %(default)s); beyond this machine the link has a token",
    )
    parser.add_argument(
        "--port", type=port, default=DEFAULT_PORT, help="port of the view, 0 for any free one (default: %(default)s)"
    )


def addresses(host: str) -> list[str]:
    """Where a browser finds what is served on `host`, as they stand in a URL; of a wildcard this machine's own."""
    if host not in {"0.0.0.0", "::", ""}:
        return [f"[{host}]" if ":" in host else host]
    found = ["127.0.0.1"]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        for _, interface in socket.if_nameindex():
            request = struct.pack("256s", interface.encode())
            with contextlib.suppress(OSError):  # an interface without an address
                answer = fcntl.ioctl(probe, SIOCGIFADDR, request)
                found.append(socket.inet_ntoa(answer[20:24]))
    return list(dict.fromkeys(found))


def check_address(host: str, port: int) -> None:
    """Before the work, which may take a while. Raises UsageError where nothing can listen."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except (OSError, UnicodeError) as error:
        if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
            return
        why = getattr(error, "strerror", None) or str(error)
        raise UsageError(
            f"--host {host} --port {port}: cannot be listened on: {why}; right is an address of this machine, such as "
            "127.0.0.1, or 0.0.0.0 for all of them"
        ) from error
