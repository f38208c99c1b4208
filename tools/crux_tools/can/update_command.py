"""`crux can sign` and `crux can update`: new firmware for nodes."""

from __future__ import annotations

import argparse
import struct
import time
from pathlib import Path
from typing import Any

from crux_contracts.node_services import number
from crux_contracts.output_file import look_at_outputs, write_whole
from crux_contracts.terminal import say

from crux_tools.arguments import taught
from crux_tools.can.image import (
    Image,
    node_kinds,
    read_images,
    read_program,
    sign,
    version_number,
    version_text,
)
from crux_tools.can.node_link import NodeLink
from crux_tools.can.param_command import add_node_options, open_link
from crux_tools.errors import UsageError, WorkFailed
from crux_tools.output import add_json_option, note, print_json, progress
from crux_tools.signing_key import new_key

CONFIRM_S = 10.0
TRIES = 4  # one more than the node has
NO_SLOT = 0xFF


def add_sign(actions: Any) -> None:
    """crux can sign."""
    parser = actions.add_parser(
        "sign",
        help="sign a node's firmware",
        **taught(
            "Makes signed images (Ed25519) of programs for `crux can update`. A microcontroller's program is linked "
            "for one of its two slots: give both, and the file fits whichever slot a node does not run from. Nodes "
            "take images signed with the key whose public half lies in them, which this command prints. --new-key "
            "makes a key first.",
            "crux can sign crux_joint_slot0.elf crux_joint_slot1.elf --kind joint --firmware-version 0.2.0 "
            "--key firmware.pem -o joint.image",
        ),
    )
    parser.add_argument(
        "programs", type=Path, metavar="PROGRAM", nargs="+", help="ELF files, one a slot; or bytes that run anywhere"
    )
    parser.add_argument("--kind", required=True, choices=sorted(node_kinds()), help="which nodes it is for")
    parser.add_argument("--firmware-version", required=True, metavar="X.Y.Z", help="newer than what the nodes run")
    parser.add_argument("--key", required=True, type=Path, metavar="FILE", help="private key, PEM")
    parser.add_argument("--new-key", action="store_true", help="make the key; FILE must not exist")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="IMAGE", help="the signed image")
    add_json_option(parser)
    parser.set_defaults(action=run_sign)


def add_update(actions: Any) -> None:
    """crux can update."""
    parser = actions.add_parser(
        "update",
        help="give a node new firmware",
        **taught(
            "Sends a signed image to a node, restarts the node and waits until the new firmware has confirmed itself; "
            "if it does not, the node goes back to the old one. The restart drops what the joint carries: the robot "
            "must be off the wall, and --off-the-wall says so.",
            "crux can update LF.joint3 joint.image --off-the-wall",
        ),
    )
    add_node_options(parser)
    parser.add_argument("image", type=Path, metavar="IMAGE", help="from `crux can sign`")
    parser.add_argument("--off-the-wall", action="store_true", help="the robot is off the wall and may drop the limb")
    add_json_option(parser)
    parser.set_defaults(action=run_update)


def run_sign(options: argparse.Namespace) -> int:
    """Exit status 0 when the image is written."""
    version = version_number(options.firmware_version)
    programs = [read_program(path) for path in options.programs]
    addresses = [program.address for program in programs]
    if len(set(addresses)) < len(addresses):
        raise UsageError("two of the programs are linked for the same address: right is one a slot")
    if options.new_key:
        if options.key.exists():
            raise UsageError(f"--new-key: {options.key} exists already")
        new_key(options.key)
    look_at_outputs({"-o": options.output}, (*options.programs, options.key))
    images = [sign(program.payload, options.kind, version, options.key, program.address) for program in programs]
    data = b"".join(image for image, _ in images)
    write_whole(options.output, data)
    public = images[0][1].hex()
    if options.json:
        print_json({
            "ok": True, "image": str(options.output), "bytes": len(data), "public_key": public, "addresses": addresses,
        })  # fmt: skip
    else:
        places = ", ".join(f"0x{address:08X}" if address else "any slot" for address in addresses)
        say(f"{options.output}: {options.kind} {version_text(version)} for {places}")
        say(f"{len(data)} bytes, public key {public}")
    return 0


def slots(link: NodeLink) -> dict[str, Any]:
    """What the node says of its slots."""
    slot, confirmed, version, other, capacity, address = struct.unpack("<BB4I", link.read(number("data", "UPDATE")))
    return {
        "slot": None if slot == NO_SLOT else slot,
        "confirmed": bool(confirmed),
        "version": version,
        "other_version": other,
        "capacity": capacity,
        "address": address,
    }


def suitable(images: list[Image], link: NodeLink, state: dict[str, Any], source: str) -> Image:
    """The image for the slot that does not run. Raises UsageError when there is none that the node would take."""
    wanted = state["address"]
    image = next((image for image in images if image.address == wanted), None)
    if image is None:
        place = f"0x{wanted:08X}, the slot that does not run" if wanted else "no address, as this node runs it"
        raise UsageError(f"{source}: no image in it is linked for {place}; sign the programs of both slots")
    if image.kind != link.name.kind:
        raise UsageError(f"{source} is for a {image.kind}, {link.name} is a {link.name.kind}")
    if image.version <= state["version"]:
        running = version_text(state["version"])
        raise UsageError(f"{source}: version {version_text(image.version)} is not newer than {running}")
    if len(image.payload) > state["capacity"]:
        raise UsageError(f"{source}: {len(image.payload)} bytes, {link.name} has space for {state['capacity']}")
    return image


def load(link: NodeLink, header: bytes, payload: bytes) -> None:
    """Sends an image. Raises Refused, or WorkFailed when the node falls silent."""
    acknowledgement = struct.pack("<I", number("acknowledgement", "OFF_THE_WALL"))
    (size,) = struct.unpack("<I", link.request("DOWNLOAD", acknowledgement + header))
    with progress(f"{link.name}: new firmware", len(payload)) as bar:
        for block, start in enumerate(range(0, len(payload), size), start=1):
            link.request("TRANSFER", bytes([block % 256]) + payload[start : start + size])
            bar.at(start + size)
    link.request("TRANSFER_EXIT")


def wait_until_confirmed(link: NodeLink, version: int) -> None:
    """Until the node has confirmed what runs; where it does not within CONFIRM_S its tries are used up by restarts.

    Raises WorkFailed when it goes back, which a node does by itself when the new firmware hangs.
    """
    for _ in range(TRIES):
        deadline_s = time.monotonic() + CONFIRM_S
        while time.monotonic() < deadline_s:
            now = slots(link)
            if now["version"] != version:
                raise WorkFailed(
                    f"{link.name} went back to {version_text(now['version'])}: {version_text(version)} did not confirm "
                    "itself; does it run on this board, and are its sensors there?"
                )
            if now["confirmed"]:
                return
            time.sleep(0.1)
        link.restart()
    raise WorkFailed(f"{link.name} runs {version_text(version)}, does not confirm it and has none to go back to")


def run_update(options: argparse.Namespace) -> int:
    """Exit status 0 when the new firmware runs and has confirmed itself."""
    images = read_images(options.image)
    if not options.off_the_wall:
        raise UsageError(
            "the node's restart drops what it carries: take the robot off the wall, then add --off-the-wall"
        )
    with open_link(options) as link:
        before = slots(link)
        image = suitable(images, link, before, str(options.image))
        load(link, image.header, image.payload)
        link.restart()
        wait_until_confirmed(link, image.version)
        after = slots(link)
    if options.json:
        print_json({"ok": True, "node": str(link.name), "before": before, "after": after})
    else:
        note(f"{link.name}: {version_text(before['version'])} -> {version_text(after['version'])}, confirmed")
    return 0
