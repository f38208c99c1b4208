"""Pace `clock` against the firmware's own nodes. Periods are judged loosely: the machine is shared."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import crux_nodes
import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_msgs import command_t
from crux_tools.paths import built
from crux_tools.priority import AWAKE
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from own_runtime import Runtime, Starter

RUN_S = 2.0
PERIOD_S = 0.002


@contextmanager
def answering_nodes(runtime: Runtime) -> Iterator[None]:
    """28 firmware nodes that stand still and answer every Sync."""
    robot = load_robot("scaler")
    still, open_m = np.zeros(crux_nodes.JOINTS), np.full(crux_nodes.LIMBS, 0.03)
    zero, wrench = np.zeros(crux_nodes.LIMBS), np.zeros((crux_nodes.LIMBS, 6))
    stop = threading.Event()

    def serve() -> None:
        with crux_nodes.Nodes(
            built("firmware/libcrux_nodes.so"),
            runtime.ports.bus_urls(),
            crux_nodes.joint_parameters(robot),
            crux_nodes.gripper_parameters(robot),
            crux_nodes.parameter_hash(robot),
        ) as nodes:
            while not stop.is_set():
                if nodes.wait_sync(0.05) is not None:
                    nodes.control(PERIOD_S, still, still, open_m, zero, zero)
                nodes.publish(still, still, still, open_m, zero, zero, wrench)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@pytest.mark.alone
def test_cycles_follow_the_clock_and_are_all_logged(start: Starter) -> None:
    runtime = start(pace="clock")
    with answering_nodes(runtime):
        time.sleep(RUN_S)
        opened = [os.path.realpath(file) for file in Path(f"/proc/{runtime.process.pid}/fd").iterdir()]
        runtime.link.send(command_t.HOLD)
        runtime.process.send_signal(signal.SIGTERM)
        status, stderr = runtime.end()
    assert status == 0, stderr
    assert "CRC" not in stderr
    assert (AWAKE in opened) == os.access(AWAKE, os.W_OK), "processors are kept from sleeping where that is permitted"
    with runtime.log.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        timing = [d for *_, d in reader.iter_decoded_messages(topics=["/cycle_timing"])]
        inputs = [d for *_, d in reader.iter_decoded_messages(topics=["/control_input"])]
    cycles = np.array([t.cycle for t in timing])
    wall_s = np.array([t.wall_ns for t in timing]) * 1e-9
    if "missing in the log" not in stderr:
        assert cycles.tolist() == list(range(1, len(cycles) + 1))
    assert len(cycles) > 0.5 * RUN_S / PERIOD_S
    period_s = np.diff(wall_s)
    assert abs(np.median(period_s) - PERIOD_S) < 0.2 * PERIOD_S
    fresh = np.mean([np.mean(i.joint_fresh) for i in inputs])
    assert fresh > 0.5  # most answers arrive within their period
    print(
        f"period median {np.median(period_s) * 1e6:.0f} us, p99 {np.quantile(period_s, 0.99) * 1e6:.0f} us; "
        f"compute {np.median([t.compute_ns for t in timing]) / 1e3:.0f} us, "
        f"send {np.median([t.send_ns for t in timing]) / 1e3:.0f} us, fresh {fresh:.3f}"
    )
