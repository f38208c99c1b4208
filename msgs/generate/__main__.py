"""Writes build/gen from the contracts. Files whose content stays the same keep their time stamp."""

from __future__ import annotations

import argparse
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

from crux_contracts import node_parameters, node_services
from crux_contracts.scenario_bodies import keys_of_version
from crux_contracts.scenario_types import VERSIONS

from . import (
    can_c,
    cdr_cpp,
    parameters_c,
    python_side,
    record_schema,
    robot_cpp,
    robot_python,
    robot_schema,
    ros2msg,
    services_c,
    tables_cpp,
    write_changed,
)
from .lcm_types import LcmSyntaxError, Struct, parse_files
from .robot_keys import read_robot_keys
from .tables import TableError, read_channels, read_faults, read_log_format

MSGS = Path(__file__).resolve().parents[1]


def _run_lcm_gen(files: list[Path], out: Path) -> None:
    tool = Path(sysconfig.get_path("scripts")) / "lcm-gen"
    with tempfile.TemporaryDirectory() as scratch:
        for language in ("cpp", "python"):
            (Path(scratch) / language).mkdir()
        subprocess.run(
            [sys.executable, tool, "--cpp", "--cpp-std=c++11", f"--cpp-hpath={scratch}/cpp",
             "--python", f"--ppath={scratch}/python", *files],
            check=True,
        )  # fmt: skip
        for generated in Path(scratch).rglob("*_t.*"):
            write_changed(out / generated.relative_to(scratch), generated.read_text(encoding="utf-8"))
        init = Path(scratch) / "python/crux_msgs/__init__.py"
        write_changed(out / "python/crux_msgs/__init__.py", init.read_text(encoding="utf-8"))


def _write_messages(structs: dict[str, Struct], out: Path) -> None:
    channels = read_channels(MSGS / "channels.yaml", structs)
    log_format = read_log_format(MSGS / "channels.yaml")
    faults = read_faults(MSGS / "faults.yaml", structs["robot_state_t"])
    cpp = out / "cpp/crux_msgs"
    write_changed(cpp / "cdr.hpp", cdr_cpp.header(structs))
    write_changed(out / "cpp/cdr.cpp", cdr_cpp.source(structs))
    runtimes = [channel for channel in channels if channel.writer != "simulation"]
    write_changed(cpp / "channels.hpp", tables_cpp.channels_header(runtimes, structs, log_format))
    write_changed(cpp / "faults.hpp", tables_cpp.faults_header(faults))
    write_changed(cpp / "ros2msg.hpp", tables_cpp.ros2msg_header(structs))
    python = out / "python/crux_msgs"
    write_changed(python / "__init__.pyi", python_side.stub(structs))
    write_changed(python / "py.typed", "")
    write_changed(python / "channel_names.py", python_side.channel_names_module(channels))
    write_changed(python / "tables.py", python_side.tables_module(structs, channels, faults, log_format))
    for struct in structs.values():
        write_changed(out / "ros2msg" / f"{struct.ros_name}.msg", ros2msg.definition(struct, structs))


def _write_robot(out: Path) -> None:
    keys = read_robot_keys(MSGS / "robot_keys.yaml")
    write_changed(out / "cpp/crux_msgs/robot.hpp", robot_cpp.header(keys))
    write_changed(out / "python/crux_msgs/robot_keys.py", robot_python.module(keys))
    write_changed(out / "schemas/robot.json", robot_schema.schema(keys))
    for version in VERSIONS:
        name = "scenario.json" if version == VERSIONS[0] else f"scenario-{version}.json"
        of_version = keys_of_version(version)
        write_changed(out / "schemas" / name, record_schema.schema(of_version, "a scenario of crux", version))


def _write_can(out: Path) -> None:
    database = can_c.load(MSGS / "can/crux.dbc")
    kinds = can_c.collapse(database)
    header, source = can_c.codec(kinds)
    write_changed(out / "c/crux_can.h", header)
    write_changed(out / "c/crux_can.c", source)
    write_changed(out / "c/crux_can_ids.h", can_c.identifiers(kinds, database))
    parameters = node_parameters.table()
    write_changed(out / "c/crux_parameters.h", parameters_c.header(parameters))
    write_changed(out / "c/crux_parameters.c", parameters_c.source(parameters))
    write_changed(out / "c/crux_services.h", services_c.header(node_services.numbers()))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder to write into (build/gen)")
    parser.add_argument("--stamp", type=Path, help="file to touch when all is written")
    options = parser.parse_args()
    files = sorted((MSGS / "lcm").glob("*.lcm"))
    try:
        structs = parse_files(files)
        _run_lcm_gen(files, options.out)
        _write_messages(structs, options.out)
        _write_robot(options.out)
        _write_can(options.out)
    except (LcmSyntaxError, TableError, can_c.CanDatabaseError, node_parameters.ParameterTableError) as error:
        print(f"msgs/generate: {error}", file=sys.stderr)
        return 1
    if options.stamp:
        options.stamp.touch()
    return 0


if __name__ == "__main__":
    sys.exit(main())
