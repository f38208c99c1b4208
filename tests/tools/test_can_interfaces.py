"""CAN interfaces as iproute2 tells of them, and what frames cost on a bus."""

from __future__ import annotations

import configparser
import dataclasses
import itertools
import json
import re
from pathlib import Path
from typing import Any

import pytest
from crux_contracts.robot import load_robot
from crux_simulation.sim import climb
from crux_tools.can.bus_load import BUDGET, LENGTHS, frame_time_s, planned_load
from crux_tools.can.interfaces import defects, parse, set_up_commands
from crux_tools.can.persist import files_of
from crux_tools.errors import UsageError, WorkFailed
from hand_plan import standing_plan

ROBOT = load_robot("scaler")


def real_link(**changes: Any) -> dict[str, Any]:
    """What `ip -details -json -statistics link show` gives for a CAN FD adapter that is set up right."""
    data = {
        "ctrlmode": ["FD", "BERR-REPORTING"],
        "state": "ERROR-ACTIVE",
        "berr_counter": {"tx": 3, "rx": 1},
        "restart_ms": 100,
        "bittiming": {"bitrate": 1000000, "sample_point": "0.800", "tq": 12, "sjw": 8, "brp": 1},
        "data_bittiming": {"bitrate": 5000000, "sample_point": "0.812", "tq": 12, "sjw": 1, "brp": 1},
        "clock": 80000000,
    }
    link = {
        "ifindex": 4,
        "ifname": "can2",
        "flags": ["NOARP", "UP", "LOWER_UP", "ECHO"],
        "mtu": 72,
        "qdisc": "pfifo_fast",
        "operstate": "UP",
        "txqlen": 18,
        "link_type": "can",
        "linkinfo": {
            "info_kind": "can",
            "info_data": data,
            "info_xstats": {"restarts": 2, "bus_error": 7, "bus_off": 2},
        },
    }
    for name, value in changes.items():
        (data if name in data else link)[name] = value
    return link


def found(**changes: Any) -> list[str]:
    loopback = {"ifname": "lo", "link_type": "loopback", "flags": ["UP"], "mtu": 65536}
    (interface,) = parse(json.dumps([loopback, real_link(**changes)]))
    return defects(interface, ROBOT)


def test_a_good_adapter_has_no_defects_and_its_counters_are_read() -> None:
    (interface,) = parse(json.dumps([real_link()]))
    assert defects(interface, ROBOT) == []
    assert interface.errors == {"tx_errors": 3, "rx_errors": 1, "restarts": 2, "bus_error": 7, "bus_off": 2}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"flags": ["NOARP", "ECHO"]}, "it is down"),
        ({"mtu": 16}, "does not carry CAN FD: mtu 16"),
        ({"bittiming": {"bitrate": 500000, "sample_point": "0.875"}}, "bit rate 500000, right is 1000000"),
        ({"bittiming": {"bitrate": 1000000, "sample_point": 0.875}}, "sample point 0.875 of the bit rate"),
        ({"data_bittiming": {"bitrate": 2000000, "sample_point": "0.8"}}, "data bit rate 2000000, right is 5000000"),
        ({"txqlen": 1000}, "plays old commands after a jam"),
        ({"txqlen": 4}, "a cycle has 10"),
        ({"restart_ms": 0}, "restart-ms 0, right is 100"),
        ({"ctrlmode": ["FD"]}, "berr-reporting off"),
        ({"state": "BUS-OFF"}, "its controller is BUS-OFF, right is ERROR-ACTIVE"),
    ],
)
def test_every_defect_is_named_alone(changes: dict[str, Any], said: str) -> None:
    (problem,) = found(**changes)
    assert said in problem


def test_what_up_would_do_is_what_check_wants() -> None:
    (interface,) = parse(json.dumps([real_link(flags=[], txqlen=10)]))
    lines = [" ".join(command) for command in set_up_commands(interface, ROBOT)]
    assert lines[0] == "ip link set can2 down"
    assert lines[-1] == "ip link set can2 up"
    words = " ".join(lines)
    for wanted in (
        "bitrate 1000000",
        "dbitrate 5000000",
        "fd on",
        "restart-ms 100",
        "txqueuelen 20",
        "berr-reporting on",
    ):
        assert wanted in words


def test_garbage_from_ip_is_said() -> None:
    with pytest.raises(WorkFailed, match="no JSON"):
        parse("Object can0")
    assert parse("") == []


def test_a_climb_without_can_says_how_to_get_some(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(climb, "available", lambda: False)
    options = climb.ClimbOptions(bus="socketcan")
    with pytest.raises(UsageError, match="crux can run --virtual-time -i can0,can1,can2,can3 -- crux climb"):
        climb.climb(standing_plan(), ROBOT, tmp_path / "log.mcap", options)


def test_frame_times_bracket_a_frame_counted_bit_by_bit() -> None:
    """A 16-byte frame: 30 bits slow; ESI 1, DLC 4, data 128, stuff count 4, CRC 17, fixed stuff bits 6 fast."""
    least, most = frame_time_s(16, 1_000_000, 5_000_000)
    assert least == pytest.approx(30e-6 + 160 / 5e6)
    # Every fourth of 22 + 128 bits from SOF to the data's end, of which the first 17 are slow: 4 slow, 33 fast.
    assert most == pytest.approx(least + 4e-6 + 33 / 5e6)
    times = [frame_time_s(length, 1_000_000, 5_000_000)[1] for length in LENGTHS]
    assert times == sorted(times)
    assert frame_time_s(13, 1_000_000, 5_000_000) == (least, most)


def test_the_robots_cycle_is_within_the_budget() -> None:
    least, most = planned_load(ROBOT)
    assert 0.45 < least < most <= BUDGET["each"]


def test_heartbeats_of_all_eight_talkers_are_counted() -> None:
    still = dataclasses.replace(ROBOT, can=dataclasses.replace(ROBOT.can, rate_Hz=0.0))
    one = frame_time_s(8, ROBOT.can.bit_rate, ROBOT.can.data_bit_rate)
    assert planned_load(still) == pytest.approx([10.0 * 8 * time for time in one])  # 10 Hz, as msgs/can/README.md says


def test_a_kilohertz_has_room_for_broadcasts_only() -> None:
    fast = dataclasses.replace(ROBOT, can=dataclasses.replace(ROBOT.can, rate_Hz=1000.0))
    assert planned_load(fast)[1] > 1.0
    least, most = planned_load(fast, "broadcast")
    assert 0.55 < least < most <= BUDGET["broadcast"]


def adapters(folder: Path, *ports: tuple[str, str, int]) -> None:
    """A /sys with one network interface for each (name, parent device, port)."""
    for name, device, port in ports:
        parent, interface = folder / "devices" / device, folder / "class" / "net" / name
        parent.mkdir(parents=True, exist_ok=True)
        interface.mkdir(parents=True)
        (interface / "device").symlink_to(parent)
        (interface / "dev_id").write_text("0x0\n")
        (interface / "dev_port").write_text(f"{port}\n")


def test_buses_are_kept_over_a_boot_by_their_adapters(tmp_path: Path) -> None:
    """Two adapters with two ports each, plugged in the other way round since: what networkd sets is what `ip` would."""
    names = ("can2", "can3", "can0", "can1")
    places = [("1-2:1.0", 0), ("1-2:1.0", 1), ("1-4:1.0", 0), ("1-4:1.0", 1)]
    adapters(tmp_path, *((name, *place) for name, place in zip(names, places, strict=True)))
    interfaces = [parse(json.dumps([real_link(ifname=name)]))[0] for name in names]
    files = files_of(interfaces, ROBOT, tmp_path)
    rules = files.pop("etc/udev/rules.d/70-crux-can.rules").splitlines()[1:]
    where = [re.findall(r'KERNELS=="([^"]+)".*dev_port}=="(\d)", NAME="(\w+)"', line)[0] for line in rules]
    buses = ("canLF", "canRF", "canLR", "canRR")
    assert where == [(device, str(port), bus) for (device, port), bus in zip(places, buses, strict=True)]
    words = [word for command in set_up_commands(interfaces[0], ROBOT) for word in command]
    option = dict(itertools.pairwise(words))
    assert all(f'tx_queue_len}}="{option["txqueuelen"]}"' in line for line in rules)
    assert sorted(files) == [f"etc/systemd/network/70-crux-can{limb}.network" for limb in ("LF", "LR", "RF", "RR")]
    for path, text in files.items():
        settings = configparser.ConfigParser(interpolation=None)
        settings.optionxform = str  # type: ignore[assignment,method-assign]
        settings.read_string(text)
        bus = dict(settings["CAN"])
        assert settings["Match"]["Name"] in path
        assert (bus["BitRate"], bus["DataBitRate"]) == (option["bitrate"], option["dbitrate"])
        assert {float(bus[name].rstrip("%")) / 100 for name in ("SamplePoint", "DataSamplePoint")} == {
            float(option["sample-point"])
        }
        assert bus["RestartSec"] == f"{option['restart-ms']}ms"
        assert (bus["FDMode"], bus["BusErrorReporting"]) == ("yes", "yes")


def test_only_four_buses_with_adapters_are_kept_over_a_boot(tmp_path: Path) -> None:
    (interface,) = parse(json.dumps([real_link()]))
    with pytest.raises(WorkFailed, match="four interfaces, not 1"):
        files_of([interface], ROBOT, tmp_path)
    with pytest.raises(WorkFailed, match="can2 has no adapter"):
        files_of([interface] * 4, ROBOT, tmp_path)
