"""Who may use a campaign's cluster: nobody but who has its keys, whatever port of whichever process is tried."""

from __future__ import annotations

import http.client
import json
import os
import socket
import ssl
import subprocess
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import psutil
import pytest
from crux_simulation.campaign.cluster import cluster
from crux_tools.cli import main
from crux_tools.errors import UsageError
from crux_tools.paths import ROOT
from distributed import Client, Security
from test_campaign import SCRIPTS, campaign, ended, let, ran, started, wait_for

PAGES = ("/", "/status", "/health", "/metrics", "/info/main/workers.html", "/json/counts.json", "/proxy/22/127.0.0.1/")
TRY_S = 5.0


def keys_of(security: Security, path: Path) -> Path:
    path.touch(mode=0o600)
    path.write_text(security.tls_client_cert + security.tls_client_key)
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("ran", "go", "out"):
        (tmp_path / name).mkdir()
    return tmp_path


def ports_of(pid: int) -> list[int]:
    """Those that a process and its children listen on."""
    parent = psutil.Process(pid)
    processes = [parent, *parent.children(recursive=True)]
    return [c.laddr.port for p in processes for c in p.net_connections("tcp") if c.status == psutil.CONN_LISTEN]


def asks_for(port: int) -> str:
    """What it says to who has no certificate."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    try:
        with socket.create_connection(("127.0.0.1", port), TRY_S) as raw, context.wrap_socket(raw) as tls:
            tls.recv(1)
    except (ssl.SSLError, TimeoutError) as error:
        return str(error)
    return "nothing"


def page(port: int, path: str) -> bytes:
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=TRY_S) as answer:
            return bytes(answer.read())
    except (OSError, http.client.HTTPException):  # refused, not found, or no HTTP at all
        return b""


def test_a_cluster_of_ones_own_answers_nobody_without_its_keys(folder: Path) -> None:
    with campaign(folder, 1) as client:
        wait_for(lambda: ran(folder, "0") != [])
        address = (folder / "address").read_text()
        ports, words = ports_of(client.pid), (folder / "join").read_text().split()
        keys = words[words.index("--tls-cert") + 1]
        assert Path(keys).parent.stat().st_mode & 0o077 == 0
        closed = [port for port in ports if "CERTIFICATE_REQUIRED" in asks_for(port)]
        assert len(closed) >= 3  # of scheduler, worker and nanny
        for port in set(ports) - set(closed):  # an empty HTTP server
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(f"http://127.0.0.1:{port}/status", timeout=TRY_S)
        assert [(port, path) for port in ports for path in PAGES if page(port, path)] == []
        with pytest.raises(OSError, match="TLS certificate does not match"):
            Client(address, security=Security.temporary(), timeout=TRY_S)
        let(folder, "0")
        ended(client)
    assert not Path(keys).exists()


def made_keys(folder: Path) -> Path:
    """As tools/README.md says."""
    words = "openssl req -x509 -newkey rsa:3072 -nodes -days 30 -subj /CN=campaign -keyout key.pem -out certificate.pem"
    assert words in (ROOT / "tools" / "README.md").read_text(encoding="utf-8")
    subprocess.run(words.split(), cwd=folder, check=True, capture_output=True)
    keys = folder / "cluster.pem"
    keys.touch(mode=0o600)
    keys.write_bytes((folder / "certificate.pem").read_bytes() + (folder / "key.pem").read_bytes())
    return keys


@pytest.fixture
def scheduler(folder: Path) -> Iterator[tuple[str, Path]]:
    """One with keys, started as tools/README.md says; its address and its keys."""
    keys, file = made_keys(folder), folder / "scheduler.json"
    tls = ("--tls-ca-file", keys, "--tls-cert", keys)
    words = ("--host", "tls://127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", file, *tls)
    with ExitStack() as stack:
        stack.enter_context(started(SCRIPTS / "dask", "scheduler", *words))
        wait_for(file.exists)
        address = json.loads(file.read_text())["address"]
        stack.enter_context(started(SCRIPTS / "dask", "worker", address, "--nthreads", "1", "--no-dashboard", *tls))
        yield address, keys


@pytest.mark.sweep
def test_a_cluster_with_keys_is_used_by_who_has_them_alone(folder: Path, scheduler: tuple[str, Path]) -> None:
    address, keys = scheduler
    let(folder, "0")
    with campaign(folder, 1, address, str(keys)) as client:
        assert "not encrypted" not in ended(client)
    assert len(ran(folder, "0")) == 1
    other = keys_of(Security.temporary(), folder / "other.pem")
    with pytest.raises(UsageError, match=f"no scheduler there that takes the keys of {other}"):
        cluster(address, other, 1).__enter__()
    with pytest.raises(UsageError, match="a cluster with TLS needs --dask-keys"):
        cluster(address, None, 1).__enter__()


def test_keys_that_cannot_be_used_are_refused_with_what_would_be_right(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec, keys, text = tmp_path / "spec.yaml", tmp_path / "keys.pem", tmp_path / "text.pem"
    spec.write_text("version: 1\nwalls: [{draw: wall, count: 1}]\n")
    keys_of(Security.temporary(), keys)
    keys.chmod(0o644)
    text.touch(mode=0o600)
    for words, said in (
        (("--dask-keys", keys), "--dask-keys: is about a cluster that runs already: give its address by --dask"),
        (("--dask-keys", keys, "--dask", "tcp://127.0.0.1:9"), "whose address begins with tls://"),
        (("--dask-keys", keys, "--dask", "tls://127.0.0.1:9"), "others may read the key in it; right is chmod 600"),
        (("--dask-keys", text, "--dask", "tls://127.0.0.1:9"), f"--dask-keys {text}: "),
        (("--dask-keys", tmp_path / "no", "--dask", "tls://127.0.0.1:9"), "No such file"),
    ):
        assert main(["campaign", str(spec), "--out", str(tmp_path / "out"), *map(str, words)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert said in line
        assert "right is" in line or "begins with" in line or "give its address" in line


def test_workers_keep_memory_as_other_processes_do() -> None:
    """With the threshold that Dask sets, planning takes twice as long."""
    with cluster(None, None, 1) as own:
        assert own.client.submit(os.environ.get, "OMP_NUM_THREADS").result() == "1"
        assert own.client.submit(os.environ.get, "MALLOC_TRIM_THRESHOLD_").result() is None
