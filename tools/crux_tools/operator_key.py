"""An operator's key: what he signs his commands with, and the line by which a runtime knows him."""

from __future__ import annotations

import getpass
import os
import socket
from pathlib import Path

from crux_msgs import signed_t

from crux_tools.errors import UsageError
from crux_tools.signing_key import new_key, read_key

PRIVATE = 0o077  # what of the mode others may have nothing of
SIGNATURE_BYTES = 64
LONGEST_NAME = 64


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

    def sealed(self, session: int, counter: int, lease: int, data: bytes) -> bytes:
        """An encoded signed_t."""
        message = signed_t()
        message.session, message.counter, message.lease, message.key = session, counter, lease, self.public
        message.n_bytes, message.data, message.signature = len(data), data, bytes(SIGNATURE_BYTES)
        content: bytes = message.encode()[:-SIGNATURE_BYTES]
        return content + self._private.sign(content)
