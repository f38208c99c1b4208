"""How the tests are shared out among processes (`pytest -n 3 --dist loadfile`, as `make test` runs them)."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from shared_plans import SharedPlans
from sweep_record import pytest_runtest_logreport, pytest_sessionfinish  # noqa: F401

FIRST, LAST = ("tests/socketcan", "tests/firmware", "tests/planner"), ("tests/examples", "tests/msgs")

# Not ignored as in a job in the background, for what tests start inherits that and could not be interrupted.
signal.signal(signal.SIGINT, signal.default_int_handler)

# A busy machine makes no test fail: how long one example takes is not what these tests are about. The same examples
# each time, so that what fails is the change; `pytest --hypothesis-profile other` looks at others.
slow = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("same", derandomize=True, **slow)
settings.register_profile("other", **slow)
settings.load_profile("same")


@pytest.fixture(scope="session", autouse=True)
def own_folders(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Keys, and runtimes that operators know, are not those of whoever runs the tests; where they are."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("XDG_STATE_HOME", "XDG_CONFIG_HOME"):
            folder = tmp_path_factory.mktemp(name.lower())
            patch.setenv(name, str(folder))
        yield folder


@pytest.fixture(autouse=True)
def forgotten_runtimes(own_folders: Path) -> None:
    """Tests draw their ports: what answered there in an earlier test, with a key of its own, is not known."""
    (own_folders / "crux" / "runtimes").unlink(missing_ok=True)


@pytest.fixture(scope="session")
def planned(tmp_path_factory: pytest.TempPathFactory) -> SharedPlans:
    """Plans that the session's processes share."""
    own = tmp_path_factory.getbasetemp()
    return SharedPlans((own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "plans")


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """For tests that do not look at a page's plots: drawing them takes most of its time."""
    from crux_tools.report import figures
    from matplotlib import pyplot as plt
    from matplotlib.figure import Figure

    def no_png(figure: Figure) -> bytes:
        plt.close(figure)
        return b"no PNG"

    monkeypatch.setattr(figures, "png", no_png)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files first and short ones last, so that all processes end at about the same time."""
    items.sort(key=lambda item: item.nodeid.startswith(LAST) - item.nodeid.startswith(FIRST))
