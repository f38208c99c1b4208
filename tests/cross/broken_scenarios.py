"""Scenarios that are wrong, each in one way, and what the message about it must name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

SCENARIO = Path(__file__).resolve().parents[2] / "msgs" / "scenarios" / "climb-four-holds.yaml"
ONE_STEP = SCENARIO.with_name("climb-one-step.yaml").read_text(encoding="utf-8")  # quick to plan
WRONG, INFEASIBLE = 2, 1
HUGE_BYTES = 100_000_000


@dataclass(frozen=True)
class Case:
    """`write` puts the broken scenario at a path; the message must have every one of `names` in it."""

    id: str
    write: Callable[[Path], None]
    names: tuple[str, ...]
    status: int = WRONG


def _base() -> str:
    return SCENARIO.read_text(encoding="utf-8")


def _text(id_: str, change: Callable[[str], str], *names: str, status: int = WRONG) -> Case:
    def write(path: Path) -> None:
        before = _base()
        after = change(before)
        assert after != before, f"{id_}: the change did nothing, the scenario has moved on"
        path.write_text(after, encoding="utf-8")

    return Case(id_, write, names, status)


def _swap(id_: str, old: str, new: str, *names: str, status: int = WRONG) -> Case:
    """The first `old` of the good scenario becomes `new`."""
    return _text(id_, lambda text: text.replace(old, new, 1), *names, status=status)


def _bytes(id_: str, content: bytes, *names: str) -> Case:
    def write(path: Path) -> None:
        path.write_bytes(content)

    return Case(id_, write, names)


def _huge(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(HUGE_BYTES)  # a hole: it costs no disk, and must cost no memory


def _without(text: str, key: str) -> str:
    return "".join(line for line in text.splitlines(keepends=True) if not line.startswith(f"{key}:"))


# What the reader of the file must find.
MALFORMED = [
    _bytes("empty file", b"", "empty"),
    _bytes("only a comment", b"# nothing\n", "empty"),
    _bytes("not YAML", b"version: 1\nwall: {slope_deg: [45\n", "YAML"),
    _bytes("binary", bytes(range(256)) * 8, "UTF-8"),
    _bytes("not UTF-8", b"version: 1\nname: caf\xe9\n", "UTF-8"),
    _bytes("a list", b"- version\n- 1\n", "mapping"),
    _bytes("deep nesting", b"version: " + b"[" * 5000 + b"]" * 5000, "version", "nested"),
    _bytes("alias bomb", b"a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n", "a"),
    _bytes("object tag", b"version: !!python/object/apply:os.system ['true']\n", "version", "tag"),
    Case("100 MB", _huge, (str(HUGE_BYTES), "at most")),
    Case("a folder", lambda path: path.mkdir(), ("folder",)),
    Case("missing file", lambda _path: None, ("no such file",)),
    _swap("duplicate key", "robot: scaler", "robot: scaler\nrobot: scaler", "robot", "twice"),
    _swap("limb twice", "    RF: {hold", "    LF: {hold", "start.grasps.LF", "twice"),
]

# One value each.
WRONG_VALUES = [
    _swap("wrong version", "version: 1", "version: 7", "version", "7", "1"),
    _swap("unknown key", "robot: scaler", "robot: scaler\ngravity: 9.81", "gravity"),
    _swap("misspelt key", "slope_deg: 45", "slope_dg: 45", "wall.slope_dg", "slope_deg"),
    _swap("unknown robot", "robot: scaler", "robot: scalar", "robot", "scalar", "scaler"),
    _text("missing key", lambda text: _without(text, "horizon"), "horizon"),
    _swap("millimetres", "size_m: [0.06, 0.06, 0.06]", "size_m: [60, 60, 60]", "holds[0].size_m", "60", "m"),
    _swap("height in mm", "[0.0, 0.0, 0.185]", "[0.0, 0.0, 185]", "start.body.position_m", "185", "m"),
    _swap("slope too steep", "slope_deg: 45", "slope_deg: 450", "wall.slope_deg", "450", "degrees"),
    _swap("NaN", "position_m: [0.14, 0.36]", "position_m: [.nan, 0.36]", "holds[0].position_m", "nan"),
    _swap("infinity", "max_normal_N: 60", "max_normal_N: .inf", "contact.max_normal_N", "inf"),
    _swap("words for a number", "slope_deg: 45", "slope_deg: steep", "wall.slope_deg", "steep", "number"),
    _swap("truth for a number", "slope_deg: 45", "slope_deg: true", "wall.slope_deg", "true"),
    _swap("two coordinates for three", "[0.0, 0.0, 0.185]", "[0.0, 0.0]", "start.body.position_m", "3"),
    _swap("faces z", "faces: x", "faces: z", "start.grasps.LF.faces", "z", "x"),
    _swap("negative friction", "friction: 2.2", "friction: -2.2", "holds[0].friction", "-2.2"),
    _swap("zero-size hold", "size_m: [0.06, 0.06, 0.06]", "size_m: [0.06, 0, 0.06]", "holds[0].size_m", "0"),
    _swap("half a step", "steps: 40", "steps: 40.5", "horizon.steps", "40.5"),
    _swap("time backwards", "dt_s: 2.0", "dt_s: -2.0", "horizon.dt_s", "-2"),
    _swap("unknown contact model", "model: patch", "model: glue", "contact.model", "glue", "patch"),
    _swap("unknown method", "horizon:", "planner: {method: magic}\nhorizon:", "planner.method", "magic", "auto"),
    _swap("hold without a name", "{name: left-front-low, ", "{", "holds[0]", "name"),
    _swap("a name twice", "name: right-front-low", "name: left-front-low", "left-front-low"),
    _swap("unknown hold", "hold: left-front-low", "hold: left-front-lo", "start.grasps.LF.hold", "left-front-lo"),
    _swap("limb without a grasp", "    RR: {hold: right-rear-low, faces: x}\n", "", "start.grasps", "RR"),
    _swap(
        "unknown limb", "    RR: {hold", "    XX: {hold: left-rear-high, faces: x}\n    RR: {hold", "start.grasps.XX"
    ),
    _swap("overlapping holds", "[0.29, 0.36]", "[0.16, 0.36]", "left-front-high", "left-front-low"),
    _swap("feet on patches", "  grasps:\n", "  feet: {LF: [0.1, 0.3]}\n  grasps:\n", "start.feet", "patch"),
]

# What only the planner can see; of an infeasible scenario the constraint and the place.
OUT_OF_REACH = [
    _swap("hold out of reach", "[0.14, 0.36]", "[0.60, 0.36]", "start.grasps.LF", "left-front-low", "reach"),
    _swap("start body out of reach", "[0.0, 0.0, 0.185]", "[0.3, 0.0, 0.185]", "start.grasps", "reach"),
    _swap("start body too high", "[0.0, 0.0, 0.185]", "[0.0, 0.0, 0.4]", "start.body.position_m", "0.4"),
    _text(
        "start not in equilibrium",
        lambda text: text.replace("friction: 2.2", "friction: 0.1").replace("spine_shear_N: 5", "spine_shear_N: 0"),
        "start.grasps",
        "equilibrium",
    ),
    _text(
        "start on faces that carry nothing",
        lambda text: text.replace("friction: 2.2", "friction: 0").replace("spine_shear_N: 5", "spine_shear_N: 0"),
        "start.grasps.LF",
        "friction",
    ),
    _swap("hold too wide to grip", "[0.06, 0.06, 0.06]", "[0.2, 0.06, 0.06]", "start.grasps.LF", "left-front-low"),
    _swap("unreachable goal", "[0.15, 0.0, 0.185]", "[2.5, 0.0, 0.185]", "goal", "reach", status=INFEASIBLE),
    _swap("goal inside the wall", "[0.15, 0.0, 0.185]", "[0.15, 0.0, 0.02]", "goal.body", "0.02", status=INFEASIBLE),
    _swap(
        "goal grasp out of reach",
        "LF: {hold: left-front-high",
        "LF: {hold: right-rear-low",
        "goal.grasps.LF",
        "right-rear-low",
        status=INFEASIBLE,
    ),
    _text("horizon too short", lambda _: ONE_STEP.replace("steps: 14", "steps: 6"), "horizon", "6", status=INFEASIBLE),
    _text(
        "no equilibrium on three limbs",
        lambda text: text.replace("max_normal_N: 60", "max_normal_N: 26").replace(
            "spine_shear_N: 5", "spine_shear_N: 0"
        ),
        "equilibrium",
        "lifts off",
        status=INFEASIBLE,
    ),
]

CASES = [*MALFORMED, *WRONG_VALUES, *OUT_OF_REACH]
