"""Locks lie where nobody else can prepare a link: what a link points to stays as it is."""

import fcntl
from contextlib import ExitStack
from pathlib import Path

import pytest
from crux_simulation.sim.ports import PORTS, run_ports
from crux_tools.errors import UsageError
from crux_tools.output import alone_with
from crux_tools.private_folder import private_folder


@pytest.fixture
def shared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A temporary folder in which others may write, too."""
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


def test_a_lock_truncates_no_file_behind_a_link(shared: Path) -> None:
    with alone_with(shared / "out.mcap"), run_ports():
        locks = list(shared.rglob("*.lock"))
    assert len(locks) == 2
    victim = shared / "victim"
    victim.write_text("precious")
    folder = private_folder()
    assert {path.parent for path in locks} == {folder}
    assert folder.stat().st_mode & 0o777 == 0o700
    for lock in locks:  # where another user could have put links before: beside the folder, not in it
        (shared / f"crux-{lock.name}").symlink_to(victim)
    with alone_with(shared / "out.mcap"), run_ports():
        assert victim.read_text() == "precious"


def test_locks_of_others_in_the_temporary_folder_leave_all_ports_free(shared: Path) -> None:
    with ExitStack() as held:
        for base in PORTS:  # named as ours, as anybody can
            lock = held.enter_context((shared / f"ports-{base}.lock").open("w"))
            fcntl.flock(lock, fcntl.LOCK_EX)
        assert len(PORTS) == 1500
        with run_ports():
            pass


@pytest.mark.parametrize("kind", ["link", "file", "open to others"])
def test_a_folder_that_is_not_ours_alone_is_refused(shared: Path, kind: str) -> None:
    place = private_folder()
    place.rmdir()
    (elsewhere := shared / "elsewhere").mkdir(mode=0o700)
    if kind == "link":
        place.symlink_to(elsewhere)
    elif kind == "file":
        place.write_text("")
    else:
        place.mkdir()
        place.chmod(0o777)
    with (
        pytest.raises(UsageError, match=r"crux-\d+: expected a folder of user \d+ .*TMPDIR"),
        alone_with(shared / "out"),
    ):
        pass
    assert not any(elsewhere.iterdir())


def test_a_runtime_folder_of_another_user_is_not_used(shared: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(shared / "missing"))
    assert private_folder().parent == shared
    (own := shared / "own").mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(own))
    assert private_folder() == own / "crux"
