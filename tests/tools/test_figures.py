"""The benches that make the paper's figures."""

from __future__ import annotations

from pathlib import Path

import pytest
from crux_contracts.scenario import parse_scenario
from crux_simulation.benchmarks.figure6 import draw as draw_gaits
from crux_simulation.benchmarks.figure6 import gait_decided, lines, trot_wall
from crux_simulation.benchmarks.residuals import FORCE, POSITION, draw, first_within, summary
from crux_simulation.benchmarks.setting import setting, setting_text


def test_at_first_diagonal_limbs_trot_and_the_checker_sees_them_tumble(tmp_path: Path) -> None:
    trot = gait_decided(parse_scenario(trot_wall(), "trot-wall"))
    assert [set(pair.split("+")) for pair in trot.order] == [{"LF", "RR"}, {"RF", "LR"}]
    assert not trot.ok
    assert trot.tumbling_Nm > 1.0
    diagram = list(lines(trot))
    assert diagram[1].count("█") == diagram[4].count("█") > 0
    draw_gaits(tmp_path / "gaits.png", [trot, trot], 2.0)
    assert (tmp_path / "gaits.png").stat().st_size > 1000


def history(*largest: tuple[float, float]) -> list[dict[str, float]]:
    return [{"position_m": p, "force_N": f, "position_rms_m": p / 3, "force_rms_N": f / 3} for p, f in largest]


@pytest.mark.parametrize(
    ("largest", "within", "ok"),
    [
        ([(0.1, 3.0), (0.02, 0.6), (0.02, 0.4)], 3, True),
        ([(0.1, 3.0), (0.02, 0.4), (0.04, 0.4)], 2, False),
        ([(0.1, 0.1)], None, False),
    ],
)
def test_residuals_count_in_the_maximum_norm(
    largest: list[tuple[float, float]], within: int | None, ok: bool, tmp_path: Path
) -> None:
    histories = {"two_block": history(*largest)}
    assert first_within(histories["two_block"]) == within
    assert summary(histories, tmp_path / "x.png")["ok"] is ok
    draw(tmp_path / "x.png", "residuals", histories, (POSITION, FORCE))
    assert (tmp_path / "x.png").stat().st_size > 1000


def test_machine_solvers_and_limits_are_named() -> None:
    said = setting()
    assert said["machine"]["cpu"]
    assert said["machine"]["cores"] >= 1
    assert all(part.split()[-1][0].isdigit() for part in said["solvers"].values())
    text = setting_text(said)
    assert max(map(len, text.splitlines())) <= 120
    for word in ("HiGHS", "ipopt", "PIQP", "seconds a MIP", "gap of a climb's MIP", "rho of multi_block"):
        assert word in text.replace("\n", " ")
