"""An operator's key: what he signs his commands with, and the line by which a runtime knows him."""

from __future__ import annotations

import fcntl
import getpass
import os
import socket
import time
from pathlib import Path

from crux_msgs import signed_t

from crux_tools.errors import UsageError
from crux_tools.signing_key import new_key, read_key

PRIVATE = 0o077  # what of the mode others may have nothing of
SIGNATURE_BYTES = 64
LONGEST_NAME = 64
HIGHEST_COUNTER = 2**63 - 1


def default_path() -> Path:
    """~/.config/crux/operator.pem, or below $XDG_CONFIG_HOME."""
    return Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config") / "crux" / "operator.pem"


def default_name() -> str:
    """user@host."""
    return f"{getpass.getuser()}@{socket.gethostname()}"


def checked_name(name: str) -> str:
    """The name. Raises UsageError for one that the runtime would not take."""
    if len(name.split()) != 1 or not name.isascii() or not name.isprintable() or len(name) > LONGEST_NAME:
        raise UsageError(f"--name {name!r}: right is one word of at most {LONGEST_NAME} characters of ASCII")
    return name


class OperatorKey:
    """The key of a file that nobody else may read. Raises UsageError, which says what to do."""

    def __init__(self, path: Path) -> None:
        try:
            mode = path.stat().st_mode
            self._private = read_key(path)
        except FileNotFoundError:
            raise UsageError(f"{path}: there is no key; `crux key new` makes one") from None
        except OSError as error:
            raise UsageError(f"{path}: {error.strerror}") from None
        if mode & PRIVATE:
            raise UsageError(f"{path}: others may read this key (mode {mode & 0o777:o}); chmod 600 {path}")
        self.public = self._private.public_key().public_bytes_raw()
        self._count = path.with_suffix(".counter")

    @staticmethod
    def new(path: Path) -> OperatorKey:
        """Makes one; leaves a key that is there already alone."""
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            new_key(path)
        except FileExistsError:
            raise UsageError(f"{path}: is there already and stays; `crux key show` shows it") from None
        except OSError as error:
            raise UsageError(f"{path}: {error.strerror}") from None
        return OperatorKey(path)

    def line(self, role: str, name: str) -> str:
        """Of the runtime's keys file."""
        return f"{self.public.hex()} {role} {name}"

    def next_counter(self) -> int:
        """Above all before it, of every process of this user: the time [ns], or one more than the last where the clock
        was set back. The last one stands in a file beside the key; where none can be written the time alone counts.
        Raises UsageError."""
        try:
            descriptor = os.open(self._count, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
            with os.fdopen(descriptor, "r+", encoding="utf-8") as file:
                fcntl.flock(file, fcntl.LOCK_EX)
                counter = max(time.time_ns(), int(file.read() or 0) + 1)
                if counter > HIGHEST_COUNTER:
                    raise ValueError(f"{counter} is too high")
                file.seek(0)
                file.write(str(counter))
                file.truncate()
                return counter
        except OSError:
            return time.time_ns()
        except ValueError as error:
            raise UsageError(f"{self._count}: {error}; right is the last counter, or no such file: remove it") from None

    def sealed(self, session: int, counter: int, lease: int, data: bytes) -> bytes:
        """An encoded signed_t."""
        message = signed_t()
        message.session, message.counter, message.lease, message.key = session, counter, lease, self.public
        message.n_bytes, message.data, message.signature = len(data), data, bytes(SIGNATURE_BYTES)
        content: bytes = message.encode()[:-SIGNATURE_BYTES]
        return content + self._private.sign(content)
