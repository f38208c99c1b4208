"""Robots as archives: read as their folders are, and refused where they are none of a robot."""

from __future__ import annotations

import os
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
from crux_contracts import robot_archive
from crux_contracts.robot import ROBOTS, RobotError, load_robot, robot_names

FILES = ("robot.yaml", "scaler.urdf")
SHIPPED = ROBOTS / "scaler"


def packed(archive: Path) -> None:
    """Compressed, by the archive's ending."""
    if archive.suffix == ".zip":
        with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as opened:
            for name in FILES:
                opened.write(SHIPPED / name, f"mine/{name}")
        return
    with tarfile.open(archive, "w:gz" if archive.suffix == ".gz" else "w:xz") as opened_tar:
        for name in FILES:
            opened_tar.add(SHIPPED / name, f"mine/{name}")


def zipped(path: Path, inside: str = "mine/", names: tuple[str, ...] = FILES) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(inside + name, (SHIPPED / Path(name).name).read_bytes())
    return path


def tarred(path: Path, inside: str = "mine/") -> Path:
    with tarfile.open(path, "w:gz") as archive:
        for name in FILES:
            archive.add(SHIPPED / name, inside + name)
        link = tarfile.TarInfo(f"{inside}link")
        link.type, link.linkname = tarfile.SYMTYPE, "/etc/passwd"
        archive.addfile(link)
    return path


@pytest.mark.parametrize("inside", ["mine/", "above/mine/", ""])
def test_an_archive_is_read_as_its_folder_is(inside: str, tmp_path: Path) -> None:
    for archive in (zipped(tmp_path / "a.zip", inside), tarred(tmp_path / "a.tar.gz", inside)):
        robot = load_robot(archive)
        assert robot.hash == load_robot("scaler").hash
        assert robot.folder.name == ("mine" if inside else "scaler")
        assert load_robot(str(archive)).folder == robot.folder  # unpacked once
        assert sorted(os.listdir(robot.folder)) == sorted(FILES)  # without the link


def test_an_archive_that_changes_is_read_again(tmp_path: Path) -> None:
    archive = zipped(tmp_path / "a.zip")
    before = load_robot(archive).folder
    archive.write_bytes(zipped(tmp_path / "b.zip", "other/").read_bytes())
    assert load_robot(archive).folder != before


def test_archives_go_by_their_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CRUX_ROBOTS", str(zipped(tmp_path / "a.zip")))
    assert "mine" in robot_names()
    assert load_robot("mine").hash == load_robot("scaler").hash


def test_what_is_no_robot_is_refused_by_the_archives_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def said(archive: Path) -> str:
        with pytest.raises(RobotError) as refused:
            load_robot(archive)
        assert str(archive) in str(refused.value)
        return str(refused.value)

    assert "0 files robot.yaml" in said(zipped(tmp_path / "none.zip", names=("scaler.urdf",)))
    assert "2 files robot.yaml" in said(zipped(tmp_path / "two.zip", names=(*FILES, "other/robot.yaml")))
    assert "../robot.yaml" in said(zipped(tmp_path / "out.zip", "../"))
    assert "/robot.yaml" in said(zipped(tmp_path / "root.zip", "/mine/"))
    for name in ("no.zip", "no.tar.gz"):
        (tmp_path / name).write_bytes(b"PK no archive")
        assert "cannot be read" in said(tmp_path / name)
    monkeypatch.setattr(robot_archive, "MOST_BYTES", 1000)
    for archive in (zipped(tmp_path / "large.zip"), tarred(tmp_path / "large.tar.gz")):
        assert "at most 1000 files" in said(archive)


@pytest.mark.parametrize("ending", [".zip", ".tar.gz", ".tar.xz"])
def test_an_archive_with_broken_bytes_is_read_or_refused(ending: str, tmp_path: Path) -> None:
    whole, random = tmp_path / f"whole{ending}", np.random.default_rng(0)
    packed(whole)
    data, refused = np.frombuffer(whole.read_bytes(), dtype=np.uint8), 0
    for number in range(40):
        broken, archive = data[: random.integers(1, len(data))] if number % 2 else data.copy(), tmp_path / f"b{ending}"
        broken = broken.copy()
        broken[random.integers(0, len(broken), 4)] ^= 0xFF
        archive.write_bytes(broken.tobytes())
        try:
            load_robot(archive)
        except RobotError:
            refused += 1
    assert refused > 30
