"""Who may ask the viewer's server: pages of its own, by the addresses it is meant to be reached by.

A browser lets any page on the web send requests to this machine, and a name of that page's owner may point here (DNS
rebinding); so requests under other names or from other pages are refused. Who may reach a server that listens beyond
this machine proves by a token in the link that he was given it.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import ipaddress
import re
import secrets
import socket
from email.message import Message
from urllib.parse import urlsplit

_IMPORTS = re.compile(r'<script type="importmap">(.*?)</script>', re.DOTALL)


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(name.partition("%")[0])
    except ValueError:
        return None


def headers(page: str) -> dict[str, str]:
    """What every answer of the server has besides, so that the browser keeps the page to what the server gives it."""
    inline = "".join(
        f" 'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"
        for script in _IMPORTS.findall(page)
    )
    policy = (
        f"default-src 'none'; script-src 'self'{inline}; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return {
        "Content-Security-Policy": policy,
        "Cross-Origin-Opener-Policy": "same-origin",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Referrer-Policy": "no-referrer",
        "X-Content-Type-Options": "nosniff",
        "X-Frame-Options": "DENY",
    }


class Guard:
    """Of a server on `address` (what it is bound to), which was asked for as `host`."""

    def __init__(self, host: str, address: str) -> None:
        bound = _address(address)
        self._local = bound is not None and bound.is_loopback
        self._names = {"localhost"} if self._local else {"localhost", socket.gethostname().lower(), host.lower()}
        self.token = "" if self._local else secrets.token_urlsafe(16)

    @property
    def prefix(self) -> str:
        """What the path of every request begins with."""
        return f"/{self.token}" if self.token else ""

    def refusal(self, asked: Message) -> str:
        """Why a request with such headers is not answered; empty where it is."""
        hosts, origins = asked.get_all("Host", []), asked.get_all("Origin", [])
        if len(hosts) != 1 or not self._is_ours(f"//{hosts[0]}"):
            return "the address is not that of this viewer: open the link that crux printed"
        if any(origin != f"http://{hosts[0]}" for origin in origins):
            return "asked by another page"
        if asked.get("Sec-Fetch-Site") in {"cross-site", "same-site"} and asked.get("Sec-Fetch-Mode") != "navigate":
            return "asked by another page"
        return ""

    def refusal_of_sent(self, asked: Message) -> str:
        """The same, besides, of a request that brings something: a browser says which page it is from, and lets no page
        of others send JSON unasked.
        """
        if not asked.get_all("Origin", []):
            return "sent by no page of this address"
        return "" if asked.get_content_type() == "application/json" else "expected JSON"

    def inner(self, path: str) -> str | None:
        """The path behind the token; None where that is not the right one."""
        if not self.token:
            return path
        first, slash, rest = path.removeprefix("/").partition("/")
        right = hmac.compare_digest(first.encode("utf-8", "replace"), self.token.encode())
        return f"{slash}{rest}" if right else None

    def _is_ours(self, url: str) -> bool:
        """Addresses as numbers cannot be pointed here by anybody."""
        try:
            name = (urlsplit(url).hostname or "").lower()
        except ValueError:
            return False
        address = _address(name)
        return name in self._names if address is None else address.is_loopback or not self._local
