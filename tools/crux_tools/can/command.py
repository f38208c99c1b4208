"""`crux can`: each action's parser sets `action`, a function of the options."""

from __future__ import annotations

import argparse
from typing import Any

from crux_can_kernel.run_command import add_kernel, add_run

from crux_tools.arguments import taught
from crux_tools.can.param_command import add_param
from crux_tools.can.setup_command import add_check, add_up
from crux_tools.can.update_command import add_sign, add_update


def add_parser(subparsers: Any) -> None:
    """Adds `crux can` with its actions."""
    parser = subparsers.add_parser(
        "can",
        help="CAN interfaces: set up, check, or a kernel that has them; parameters and firmware of nodes",
        **taught(
            "CAN interfaces of this machine: set up and check them; or a kernel that has some. Nodes on the buses: "
            "their parameters, their firmware.",
            "crux can check --measure 2",
            "crux can param LF.joint3",
            "crux can up --help",
        ),
    )
    actions = parser.add_subparsers(dest="can_action", metavar="ACTION", required=True)
    add_up(actions)
    add_check(actions)
    add_param(actions)
    add_update(actions)
    add_sign(actions)
    add_run(actions)
    add_kernel(actions)


def run(options: argparse.Namespace) -> int:
    """Exit status of the action."""
    return int(options.action(options))
