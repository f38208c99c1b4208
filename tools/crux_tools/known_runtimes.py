"""Whose answers an operator believes: runtimes' public keys, kept from the first contact or written down by hand."""

from __future__ import annotations

import contextlib
import os
from dataclasses import dataclass
from pathlib import Path

from crux_tools.errors import UsageError
from crux_tools.operator_key import default_path as operator_key_path
from crux_tools.signing_key import read_key

KEY_BYTES = 32


def known_path() -> Path:
    """~/.config/crux/runtimes, or below $XDG_CONFIG_HOME: a line a runtime, its LCM address and its key."""
    return operator_key_path().with_name("runtimes")


def own_key() -> bytes | None:
    """Of the runtimes that this user starts himself, without --identity: who has it is the user."""
    state = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")
    with contextlib.suppress(OSError, UsageError):
        return read_key(state / "crux" / "runtime.pem").public_key().public_bytes_raw()
    return None


@dataclass
class KnownRuntime:
    """What is known of the runtime at an LCM address. Of a file that cannot be read nothing is believed; HOLD needs no
    belief."""

    url: str

    def __post_init__(self) -> None:
        self.address = self.url.partition("?")[0]
        self.path = known_path()
        self._own, self._trouble = own_key(), ""
        self.pinned: bytes | None = None
        self._line = 0
        try:
            self.pinned, self._line = self._read()
        except UsageError as error:
            self._trouble = str(error)

    def _read(self) -> tuple[bytes | None, int]:
        try:
            lines = self.path.read_text(encoding="utf-8").splitlines()
        except FileNotFoundError:
            return None, 0
        except (OSError, ValueError) as error:
            raise UsageError(f"{self.path}: {error}") from None
        for number, line in enumerate(lines, start=1):
            words = line.split()
            if not words or words[0].startswith("#") or words[0] != self.address:
                continue
            with contextlib.suppress(ValueError):
                if len(words) == 2 and len(key := bytes.fromhex(words[1])) == KEY_BYTES:
                    return key, number
            raise UsageError(f"{self.path}:{number}: {line!r}: right is {self.address} and 64 hexadecimal digits")
        return None, 0

    def believes(self, key: bytes) -> bool:
        """Whether an answer that is signed with it is the runtime's; at the first contact any is, for the moment."""
        return not self._trouble and (self.pinned is None or key in (self.pinned, self._own))

    def is_certain(self, key: bytes) -> bool:
        """Not by the first contact alone."""
        return key in (self.pinned, self._own)

    def pin(self, key: bytes, for_good: bool) -> None:
        """From now on, or for as long as this object lives, none but this one is believed at the address."""
        self.pinned = key
        if not for_good:
            return
        with contextlib.suppress(
            OSError
        ):  # a folder that is full or cannot be written: the next contact is a first one
            self.path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            with self.path.open("a", encoding="utf-8") as file:
                file.write(f"{self.address} {key.hex()}\n")
        self._line = self._read()[1]

    def changed(self, key: bytes) -> str:
        """What to tell the operator where another key answers than the one he knows."""
        return self._trouble or (
            f"what answers at {self.address} has key {key.hex()}, not the one in {self.path}:{self._line}. Somebody "
            "else answers for the runtime, or its key was made anew: then remove that line. HOLD was sent all the same"
        )
