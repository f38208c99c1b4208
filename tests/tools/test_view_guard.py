"""Who is answered by the viewer's server: not pages of others, not who lacks the token."""

from __future__ import annotations

import http.client
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from crux_contracts.plan_file import write_plan
from crux_tools.report.page import page as report
from crux_tools.view.browser import open_page
from crux_tools.view.pictures import READY
from crux_tools.view.recording import recording_of
from crux_tools.view.server import Source, Viewer, still
from made_up_climb import made_up_plan

PATHS = ("/", "/page.js", "/story", "/at?time_s=0&span_s=1")


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Source:
    path = tmp_path_factory.mktemp("guard") / "plan.mcap"
    write_plan(path, made_up_plan())
    recording = recording_of(path)
    assert recording is not None
    return still(recording)


@pytest.fixture(scope="module")
def local(source: Source) -> Iterator[Viewer]:
    viewer = Viewer([source], "127.0.0.1", 0)
    yield viewer
    viewer.close()


@pytest.fixture(scope="module")
def public(source: Source) -> Iterator[Viewer]:
    viewer = Viewer([source], "0.0.0.0", 0)
    yield viewer
    viewer.close()


def asked(viewer: Viewer, path: str, *headers: tuple[str, str]) -> http.client.HTTPResponse:
    """By these headers alone."""
    connection = http.client.HTTPConnection("127.0.0.1", viewer.port, timeout=60)
    connection.putrequest("GET", path, skip_host=True)
    for name, value in headers:
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    answer.read()
    connection.close()
    return answer


@pytest.mark.parametrize("path", PATHS)
def test_a_foreign_host_is_refused(local: Viewer, public: Viewer, path: str) -> None:
    for name in (f"127.0.0.1:{local.port}", f"localhost:{local.port}", "localhost:9000", "[::1]:1"):
        assert asked(local, path, ("Host", name)).status == 200
    foreign = [
        "evil.example",
        f"evil.example:{local.port}",
        "127.0.0.1.evil.example",
        "localhost.evil.example",
        "",
        "[",
        "a@b",
    ]
    for name in foreign:
        assert asked(local, path, ("Host", name)).status == 403
        assert asked(public, public.guard.prefix + path, ("Host", name)).status == 403
    assert asked(local, path, ("Host", f"192.168.1.20:{local.port}")).status == 403
    assert asked(local, path).status == 403
    assert asked(local, path, ("Host", "localhost"), ("Host", "evil.example")).status == 403
    assert asked(local, f"http://evil.example{path}", ("Host", "localhost")).status == 403


@pytest.mark.parametrize("path", PATHS)
def test_another_page_is_refused(local: Viewer, path: str) -> None:
    host = ("Host", f"localhost:{local.port}")
    assert asked(local, path, host, ("Origin", f"http://localhost:{local.port}")).status == 200
    assert asked(local, path, host, ("Sec-Fetch-Site", "same-origin")).status == 200
    assert asked(local, path, host, ("Sec-Fetch-Site", "cross-site"), ("Sec-Fetch-Mode", "navigate")).status == 200
    for origin in ("http://evil.example", "null", f"https://localhost:{local.port}", "http://localhost:1"):
        assert asked(local, path, host, ("Origin", origin)).status == 403
    for site in ("cross-site", "same-site"):
        assert asked(local, path, host, ("Sec-Fetch-Site", site), ("Sec-Fetch-Mode", "no-cors")).status == 403


def test_beyond_this_machine_the_token_of_the_link_is_needed(public: Viewer, source: Source) -> None:
    host, token = ("Host", f"10.0.0.7:{public.port}"), public.guard.token
    assert len(token) >= 20
    assert all(url.endswith(f":{public.port}/{token}") for url in public.urls)
    for path in PATHS:
        assert asked(public, f"/{token}{path}", host).status == 200
        for wrong in ("", "/", f"/{token[:-1]}", f"/{token}x", "/" + "a" * len(token), "/%C3%A9"):
            assert asked(public, wrong + path, host).status == 403
    whole = asked(public, f"/{token}", host)
    assert (whole.status, whole.getheader("Location")) == (308, f"/{token}/")
    other = Viewer([source], "0.0.0.0", 0)
    other.close()
    assert other.guard.token != token


def test_every_answer_keeps_the_page_to_itself(local: Viewer) -> None:
    host = ("Host", "localhost")
    answers = [asked(local, path, host) for path in (*PATHS, "/nothing")] + [asked(local, "/", ("Host", "evil"))]
    for answer in answers:
        policy = str(answer.getheader("Content-Security-Policy"))
        assert "default-src 'none'" in policy
        assert "frame-ancestors 'none'" in policy
        assert "unsafe" not in policy
        assert not re.search(r"https?:|\*", policy)
        assert answer.getheader("X-Content-Type-Options") == "nosniff"
        assert answer.getheader("X-Frame-Options") == "DENY"
        assert answer.getheader("Referrer-Policy") == "no-referrer"
        assert answer.getheader("Cross-Origin-Resource-Policy") == "same-origin"
        assert answer.getheader("Access-Control-Allow-Origin") is None
        assert "Python" not in str(answer.getheader("Server"))


def test_the_page_works_under_its_policy_and_behind_its_token(public: Viewer) -> None:
    with open_page(public.url + "/#t=1.0", (700, 500)) as page:
        page.wait_until(READY)
        assert page.value("crux.page.spaces.length") == 1
        ran = "document.body.append(Object.assign(document.createElement('script'), { textContent: 'window.ran = 1' }))"
        page.value(f"{ran}; 0")
        assert page.value("window.ran") is None
        assert all("Content Security Policy" in error for error in page.errors)


def test_a_report_runs_no_script(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    html = report("a", "b", [])
    path.write_text(html.replace("</main>", "<script>window.ran = 1</script><p id='end'></p></main>"))
    with open_page(path.as_uri(), (300, 300)) as page:
        page.wait_until("document.getElementById('end') !== null")
        assert page.value("window.ran") is None
        assert page.value("getComputedStyle(document.querySelector('main')).maxWidth") != "none"  # its style counts
