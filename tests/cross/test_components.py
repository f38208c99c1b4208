"""Who may use whom: components know only what precedes them in the data flow, tools the planner's public part."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
COMPONENT_OF = {"crux_contracts": "msgs", "crux_msgs": "msgs", "generate": "msgs", "crux_planner": "planner"}
COMPONENT_OF |= {"crux_tools": "tools", "crux_simulation": "tools", "crux_can_kernel": "tools"}
COMPONENT_OF |= {"crux_nodes": "firmware"}
MAY_USE = {"msgs": set(), "planner": {"msgs"}, "runtime": {"msgs"}, "firmware": {"msgs"}, "tools": {"msgs", "planner"}}
DRAWS = ("robot3d", "report", "view")  # by MuJoCo, which crux-sim brings; nothing else of crux_tools needs them
SHOWS = {  # open a page where the viewer is installed, once all else is done
    "tools/crux_tools/replay/command.py",
    "tools/crux_tools/robot/command.py",
}
CAN_TABLE = "tools/crux_tools/can/command.py"  # of what `crux can` does: there alone the kernel builder is named
COMMAND_LINE = {"crux_tools.arguments", "crux_tools.can", "crux_tools.errors", "crux_tools.output"}
TABLE = "tools/crux_tools/cli.py"  # of commands: there alone the simulation is named by what an operator installs
PUBLIC = re.compile(r"crux_planner(\.(cli|errors|method_report|checker(\.\w+)*))?")
LAYERS = ["errors", "model", "reach", "solvers", "physics", "swing", "search", "trajectory", "admm", "certificates"]
LAYERS += [
    "pipeline",
    "method_report",
    "__init__",
    "cli",
]  # each uses only those before it; from "pipeline", the checker
FOLDERS = {"core": set(), "bus": {"core"}, "exchange": {"core", "bus"}, "lcm": {"core", "bus", "exchange"}}
FOLDERS |= {"telemetry": {"core", "exchange"}, "app": {"core", "bus", "exchange", "lcm", "telemetry"}}
ROOMS = ["robot", "plan", "estimate", "loads", "limb", "grips", "supervise"]  # of the control core, in order
NODE = {"safety": set(), "core": {"safety"}, "service": {"core", "safety", "update"}}
NODE |= {"update": {"core", "safety", "service"}}
WORDS = {"codec.h", "frame.h", "parameters.h"}  # of the core: names and layouts, which the safety component uses too


def python_imports(component: str) -> Iterator[tuple[Path, str]]:
    for path in sorted((ROOT / component).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                yield from ((path, name.name) for name in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module is not None:
                yield path, node.module


def includes(folder: Path) -> Iterator[tuple[Path, str]]:
    for path in sorted(path for path in folder.rglob("*") if path.suffix in (".c", ".h", ".cpp", ".hpp")):
        for name in re.findall(r'^#include "([^"]+)"', path.read_text(encoding="utf-8"), re.MULTILINE):
            yield path, name


@pytest.mark.parametrize("component", MAY_USE)
def test_python_of_a_component_imports_only_what_precedes_it(component: str) -> None:
    used = [
        (path, name, COMPONENT_OF.get(name.partition(".")[0], component)) for path, name in python_imports(component)
    ]
    astray = [f"{path}: {name}" for path, name, of in used if of not in {component, *MAY_USE[component]}]
    assert not astray


def test_tools_use_only_the_public_part_of_the_planner() -> None:
    used = [(path, name) for path, name in python_imports("tools") if name.partition(".")[0] == "crux_planner"]
    assert used
    assert not [f"{path}: {name}" for path, name in used if PUBLIC.fullmatch(name) is None]


def test_what_an_operator_installs_does_without_the_simulation() -> None:
    files = sorted((ROOT / "tools" / "crux_tools").rglob("*.py"))
    naming = {path for path in files if "crux_simulation" in path.read_text(encoding="utf-8")}
    assert {str(path.relative_to(ROOT)) for path in naming} == {TABLE}
    assert not [name for path, name in python_imports("tools/crux_tools") if name.startswith("crux_simulation")]


def test_what_an_operator_installs_does_without_the_kernel_builder() -> None:
    naming = {str(path.relative_to(ROOT)) for path, name in python_imports("tools/crux_tools") if "can_kernel" in name}
    assert naming == {CAN_TABLE}
    used = {name for _, name in python_imports("tools/crux_can_kernel") if name.startswith("crux_")}
    assert {name for name in used if not name.startswith("crux_can_kernel")} == COMMAND_LINE


def test_what_commands_a_robot_does_without_drawing_it() -> None:
    package = ROOT / "tools" / "crux_tools"
    of = re.compile(rf"crux_tools\.({'|'.join(DRAWS)})\b|mujoco")
    imports = python_imports("tools/crux_tools")
    rest = [(path, name) for path, name in imports if path.relative_to(package).parts[0] not in DRAWS]
    used = [(str(path.relative_to(ROOT)), name) for path, name in rest if of.match(name)]
    assert {path for path, _ in used} == SHOWS, used


def test_the_checker_shares_nothing_with_the_planner() -> None:
    checker = ROOT / "planner" / "crux_planner" / "checker"
    used = [(path, name) for path, name in python_imports("planner/crux_planner/checker") if "crux_planner" in name]
    assert len(used) > len(list(checker.glob("*.py"))) / 2
    assert not [f"{path}: {name}" for path, name in used if not name.startswith("crux_planner.checker")]


def module_imports(folder: str) -> dict[str, set[str]]:
    """Module by module below a folder, what it imports of the others: at the top, inside functions, for types alike."""
    root = ROOT / folder
    modules = {path: ".".join(path.relative_to(root).with_suffix("").parts) for path in sorted(root.rglob("*.py"))}
    graph: dict[str, set[str]] = {name.removesuffix(".__init__"): set() for name in modules.values()}
    for path, name in modules.items():
        used, package = graph[name.removesuffix(".__init__")], name.split(".")[:-1]
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                used |= {each.name for each in node.names}
            elif isinstance(node, ast.ImportFrom):
                above = package[: len(package) + 1 - node.level] if node.level else []
                of = ".".join([*above, node.module] if node.module else above)
                used |= {inner if (inner := f"{of}.{each.name}") in graph else of for each in node.names}
    return {name: (used & graph.keys()) - {name} for name, used in graph.items()}


def test_the_planner_uses_only_layers_below() -> None:
    graph = module_imports("planner")
    layer_of = {module: [*module.split("."), "__init__"][1] for module in graph}
    assert set(layer_of.values()) == {*LAYERS, "checker"}
    upward = []
    for module, used in graph.items():
        layer = layer_of[module]
        for other in sorted(of for name in used if (of := layer_of[name]) != layer):
            below = LAYERS.index("pipeline") if other == "checker" else LAYERS.index(other) + 1
            if layer == "checker" or LAYERS.index(layer) < below:
                upward.append(f"{module}: {other}")
    assert not upward


def assert_no_circle(graph: dict[str, set[str]]) -> None:
    """Takes away what uses nothing that is left."""
    while free := [module for module, used in graph.items() if not used & graph.keys()]:
        for module in free:
            del graph[module]
    assert not graph, f"among these: {sorted(graph)}"


@pytest.mark.parametrize("folder", ["msgs", "msgs/python", "planner", "tools", "firmware/ports/host"])
def test_python_is_imported_in_no_circle(folder: str) -> None:
    graph = module_imports(folder)
    assert graph
    assert_no_circle(graph)


@pytest.mark.parametrize("folder", FOLDERS)
def test_folders_of_the_runtime_include_only_what_they_stand_on(folder: str) -> None:
    for path, name in includes(ROOT / "runtime" / folder):
        of, _, rest = name.partition("/")
        assert not rest or of in {folder, "crux_msgs", *FOLDERS[folder]}, f"{path}: {name}"


def core_includes() -> dict[str, set[str]]:
    """Module by module of the control core, what it includes of it; a header and its source are one module."""
    core = ROOT / "runtime" / "core"
    graph: dict[str, set[str]] = {}
    for path in core.rglob("*.[ch]pp"):
        graph[path.relative_to(core).with_suffix("").as_posix()] = set()
    for path, name in includes(core):
        if name.startswith("core/"):
            module = path.relative_to(core).with_suffix("").as_posix()
            graph[module] |= {name.removeprefix("core/").removesuffix(".hpp")} - {module}
    return graph


def test_the_control_core_includes_only_rooms_below() -> None:
    graph = core_includes()
    assert {module.rpartition("/")[0] for module in graph} == {"", *ROOMS}
    floors = {room: floor for floor, room in enumerate([*ROOMS, ""])}
    upward = []
    for module, used in graph.items():
        for other in used:
            if floors[other.rpartition("/")[0]] > floors[module.rpartition("/")[0]]:
                upward.append(f"{module}: {other}")
    assert not upward


def test_the_control_core_includes_in_no_circle() -> None:
    assert_no_circle(core_includes())


@pytest.mark.parametrize("folder", NODE)
def test_a_node_knows_neither_port_nor_what_is_composed_beside_it(folder: str) -> None:
    homes = {path.name: path.parent.name for path in (ROOT / "firmware").rglob("*.h")}
    homes |= {path.name: "core" for path in (ROOT / "firmware" / "core").rglob("*.h")}
    for path, name in includes(ROOT / "firmware" / folder):
        home = homes.get(name.rpartition("/")[2], folder)
        assert name in WORDS or home in {folder, *NODE[folder]}, f"{path}: {name} of {home}"


def test_the_firmware_includes_nothing_of_the_simulation() -> None:
    simulated = {path.name for path in (ROOT / "tools" / "sim").rglob("*.h*")}
    assert simulated
    used = [f"{path}: {name}" for path, name in includes(ROOT / "firmware") if name.rpartition("/")[2] in simulated]
    assert not used
