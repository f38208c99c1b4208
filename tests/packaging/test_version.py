"""Packages have the tag's version, or say which commit they are of."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from crux_tools.paths import ROOT


def git(folder: Path, *words: str) -> str:
    who = ["-c", "user.name=crux", "-c", "user.email=crux@localhost"]
    done = subprocess.run(["git", *who, *words], cwd=folder, check=True, capture_output=True, text=True)
    return done.stdout.strip()


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    """A repository of one commit, version 0.3.0."""
    (tmp_path / "tools" / "setup").mkdir(parents=True)
    shutil.copy(ROOT / "tools" / "setup" / "version", tmp_path / "tools" / "setup")
    (tmp_path / "pyproject.toml").write_text('[project]\nversion = "0.3.0"\n')
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-qm", "Begin")
    return tmp_path


def version(folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([folder / "tools" / "setup" / "version"], capture_output=True, text=True, check=False)


def test_a_tagged_commit_has_the_tags_version(sources: Path) -> None:
    git(sources, "tag", "nightly")
    assert version(sources).stdout == f"0.3.0~g{git(sources, 'rev-parse', '--short=7', 'HEAD')}\n"
    git(sources, "tag", "v0.3.0")
    assert version(sources).stdout == "0.3.0\n"


def test_an_archive_of_the_sources_says_that_its_commit_is_unknown(sources: Path, tmp_path: Path) -> None:
    """Also below a repository of somebody else's, whose commit it must not take."""
    archive = tmp_path / "home" / "crux"
    shutil.copytree(sources / "tools", archive / "tools")
    shutil.copy(sources / "pyproject.toml", archive)
    assert version(archive).stdout == "0.3.0~unknown\n"
    shutil.copytree(ROOT / "msgs" / "generate", archive / "msgs" / "generate")
    words = [sys.executable, "-m", "generate.commit", "--out", str(archive / "gen")]
    subprocess.run(words, cwd=archive / "msgs", check=True)
    assert (archive / "gen" / "python" / "crux_commit.py").read_text() == 'COMMIT: str = "unknown"\n'
    assert '"unknown"' in (archive / "gen" / "cpp" / "commit.cpp").read_text()


def test_a_repository_that_git_refuses_has_no_version(sources: Path) -> None:
    (sources / ".git" / "HEAD").write_text("broken")
    refused = version(sources)
    assert refused.returncode != 0
    assert refused.stdout == ""
    assert "fatal" in refused.stderr


def test_a_tag_that_is_not_the_declared_version_is_refused(sources: Path) -> None:
    git(sources, "tag", "v0.4.0")
    refused = version(sources)
    assert (refused.returncode, refused.stdout) == (1, "")
    assert "tagged v0.4.0, pyproject.toml says 0.3.0" in refused.stderr
