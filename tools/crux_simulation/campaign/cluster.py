"""The Dask cluster that jobs run on: one of this machine's own, which nobody else can use, or one that runs already.

Whoever may speak to a scheduler or worker runs programs as its user. A cluster of one's own therefore speaks TLS with
keys made for it, which are in a folder that only this user may read, and its pages over HTTP are empty.
"""

from __future__ import annotations

import logging
import shlex
import signal
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import dask
from crux_tools.errors import UsageError
from crux_tools.output import note
from distributed import Client, LocalCluster, Security

CONNECT_S = 10.0
RESTART_S = "1h"  # that a worker may take to start anew, on a busy machine: after that it is given up
OPEN = (
    "is not encrypted: anyone who reaches it can run programs as the users its workers run as, and as you; use it only "
    "in a network where you trust everyone, or start it with keys (tools/README.md, campaigns)"
)
_BLAS = ("OMP", "MKL", "OPENBLAS")
_SETTINGS = {
    "distributed.deploy.lost-worker-timeout": RESTART_S,
    "distributed.scheduler.http.routes": [],  # the HTTP servers themselves cannot be left out
    "distributed.worker.http.routes": [],
    # Without MALLOC_TRIM_THRESHOLD_, which Dask adds: with it every array is given back to the system at once, and
    # planning takes twice as long.
    "distributed.nanny.pre-spawn-environ": dict.fromkeys([f"{name}_NUM_THREADS" for name in _BLAS], 1),
}


@dataclass(frozen=True)
class Cluster:
    """`join`: the command by which a worker joins."""

    client: Client
    join: str


@contextmanager
def cluster(address: str | None, keys: Path | None, workers: int) -> Iterator[Cluster]:
    """The cluster at `address`, else one of this machine's own, with so many processes.

    `keys`: a PEM file with a certificate, its key and the certificate of the authority that signed those of the
    cluster. Raises UsageError where there is no scheduler, or none that takes these keys.
    """
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters of it is said by the commands
    if address is None:
        if keys is not None:
            raise UsageError("--dask-keys: is about a cluster that runs already: give its address by --dask")
        with _own_cluster(workers) as own:
            yield own
        return
    if not address.startswith("tls://"):
        if keys is not None:
            raise UsageError(
                f"--dask {address}: --dask-keys needs a cluster with TLS, whose address begins with tls://"
            )
        note(f"--dask {address}: {OPEN}")
    security = None if keys is None else _security(keys)
    try:
        client = Client(address, timeout=CONNECT_S, security=security)
    except TypeError:  # Dask's own words for an address of tls:// without keys
        raise UsageError(f"--dask {address}: a cluster with TLS needs --dask-keys FILE.pem") from None
    except (OSError, ValueError) as error:
        what = "no scheduler there" if keys is None else f"no scheduler there that takes the keys of {keys}"
        raise UsageError(f"--dask {address}: {what}: {error}") from None
    with client:
        yield Cluster(client, _join(address, keys))


@contextmanager
def _own_cluster(workers: int) -> Iterator[Cluster]:
    security = Security.temporary()
    with tempfile.TemporaryDirectory(prefix="crux-campaign-", ignore_cleanup_errors=True) as folder:
        keys = Path(folder) / "keys.pem"
        keys.write_text(security.tls_client_cert + security.tls_client_key)
        settings: dict[str, Any] = {
            "memory_limit": None,
            "host": "127.0.0.1",
            "dashboard_address": "127.0.0.1:0",
            "scheduler_kwargs": {"dashboard": False},
        }
        with dask.config.set(_SETTINGS):
            interrupted = signal.signal(
                signal.SIGINT, signal.SIG_IGN
            )  # Ctrl-C is for this process, which ends the workers
            try:
                local = LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    silence_logs=logging.CRITICAL,
                    security=security,
                    local_directory=folder,
                    **settings,
                )
            finally:
                signal.signal(signal.SIGINT, interrupted)
            with local, Client(local) as client:
                yield Cluster(client, _join(client.scheduler.address, keys))


def _join(address: str, keys: Path | None) -> str:
    tls = "" if keys is None else f" --tls-ca-file {shlex.quote(str(keys))} --tls-cert {shlex.quote(str(keys))}"
    return f"dask worker {address} --nthreads 1{tls}"


def _security(keys: Path) -> Security:
    """Raises UsageError for a file that is missing, that others may read, or that holds no certificate with its key."""
    try:
        shared = stat.S_IMODE(keys.stat().st_mode) & (stat.S_IRWXG | stat.S_IRWXO)
        if shared:
            raise UsageError(f"--dask-keys {keys}: others may read the key in it; right is chmod 600 {keys}")
        files = {f"tls_{role}": str(keys) for role in ("ca_file", "client_cert")}
        security = Security(require_encryption=True, **files)
        security.get_connection_args("client")
    except OSError as error:  # ssl.SSLError is one
        why = error.strerror if type(error) is not OSError and error.filename else str(error)
        raise UsageError(
            f"--dask-keys {keys}: {why}; right is a PEM file with a certificate, its key and the certificate that the "
            "cluster's are signed by"
        ) from None
    return security
