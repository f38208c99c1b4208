"""Listens to a runtime that climbs: once a second how far it is and how much of their grip its limbs use.

python examples/watch_a_climb.py &
crux sim out/plan.mcap -o out/practice.mcap &     # or a robot; then crux upload out/plan.mcap, crux start
"""

import argparse
from contextlib import suppress

from crux_contracts import LIMB_NAMES, channels
from crux_contracts.channels import FAULT_BY_CODE
from crux_contracts.lcm_bytes import decoded
from crux_msgs import fault_t, limb_telemetry_t, robot_state_t
from crux_tools.lcm_socket import LcmSocket
from crux_tools.operator_link import DEFAULT_URL

STATES = ("idle", "ready", "climbing", "holding", "fault")


class Watch:
    """What the runtime said last."""

    def __init__(self, url: str) -> None:
        self.connection = LcmSocket(url)
        self.on = {
            channels.CRUX_ROBOT_STATE: self.on_state,
            channels.CRUX_LIMB_TELEMETRY: self.on_limb,
            channels.CRUX_FAULT: self.on_fault,
        }
        self.used = [0.0] * len(LIMB_NAMES)  # share of the limit surface
        self.told_s = float("-inf")
        self.complete = False

    def listen(self) -> None:
        """Takes the next message; what is no such message is ignored."""
        heard = self.connection.receive(1.0, lambda channel, _data: channel in self.on)
        if heard is not None:
            with suppress(ValueError, LookupError):
                self.on[heard[0]](heard[1])

    def on_state(self, data: bytes) -> None:
        state = decoded(robot_state_t, data)
        self.complete = bool(state.plan_complete)
        if state.time_s >= self.told_s + 1 or self.complete:
            self.told_s = state.time_s
            used = "  ".join(f"{name} {share:4.0%}" for name, share in zip(LIMB_NAMES, self.used, strict=True))
            where = f"{state.plan_time_s:6.1f} of {state.plan_end_s:.1f} s"
            print(f"{STATES[state.supervisor_state]:8s}  plan {where}  limit surface used: {used}", flush=True)

    def on_limb(self, data: bytes) -> None:
        limb = decoded(limb_telemetry_t, data)
        self.used[limb.limb] = limb.utilisation

    def on_fault(self, data: bytes) -> None:
        fault = decoded(fault_t, data)
        print(f"fault {fault.code}: {FAULT_BY_CODE[fault.code].name}", flush=True)


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lcm", default=DEFAULT_URL)
    watch = Watch(parser.parse_args(words).lcm)
    while not watch.complete:
        watch.listen()


if __name__ == "__main__":
    main()
