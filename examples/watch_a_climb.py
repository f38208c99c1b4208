"""Listens to a runtime that climbs: once a second how far it is and how much of their grip its limbs use.

python examples/watch_a_climb.py &
crux sim out/plan.mcap -o out/practice.mcap &     # or a robot; then crux upload out/plan.mcap, crux start
"""

import argparse
from contextlib import suppress

from crux_contracts import LIMB_NAMES, channels
from crux_contracts.channels import FAULT_BY_CODE, SUPERVISOR_STATES
from crux_contracts.lcm_bytes import decoded
from crux_msgs import fault_t, limb_telemetry_t, robot_state_t
from crux_tools.lcm_socket import LcmSocket
from crux_tools.operator_link import DEFAULT_URL


class Watch:
    def __init__(self, url: str) -> None:
        self.connection = LcmSocket(url)
        self.used = [0.0] * len(LIMB_NAMES)  # share of the limit surface
        self.told_s, self.complete = float("-inf"), False

    def listen(self) -> None:
        if (message := self.connection.receive(1.0)) is not None:
            with suppress(ValueError, LookupError):  # no such message
                self.take(message[0], message[1])

    def take(self, channel: str, data: bytes) -> None:
        if channel == channels.CRUX_ROBOT_STATE:
            self.on_state(decoded(robot_state_t, data))
        elif channel == channels.CRUX_LIMB_TELEMETRY:
            limb = decoded(limb_telemetry_t, data)
            self.used[limb.limb] = limb.utilisation
        elif channel == channels.CRUX_FAULT:
            code = decoded(fault_t, data).code
            print(f"fault {code}: {FAULT_BY_CODE[code].name}", flush=True)

    def on_state(self, state: robot_state_t) -> None:
        self.complete = bool(state.plan_complete)
        if state.time_s >= self.told_s + 1 or self.complete:
            self.told_s = state.time_s
            used = "  ".join(f"{name} {share:4.0%}" for name, share in zip(LIMB_NAMES, self.used, strict=True))
            where = f"plan {state.plan_time_s:6.1f} of {state.plan_end_s:.1f} s"
            name = SUPERVISOR_STATES[state.supervisor_state].lower()
            print(f"{name:8s}  {where}  limit surface used: {used}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lcm", default=DEFAULT_URL)
    watch = Watch(parser.parse_args().lcm)
    while not watch.complete:
        watch.listen()


if __name__ == "__main__":
    main()
