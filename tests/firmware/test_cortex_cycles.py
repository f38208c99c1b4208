"""Bounds of the cycles that instructions take: of small programs counted by hand, and of every instruction of an image
against a table by mnemonics, as a disassembler writes them."""

from __future__ import annotations

import re
import struct
import subprocess
from pathlib import Path

import pytest
from crux_contracts.robot import load_robot
from crux_simulation.sim import crux_emulated
from crux_tools.paths import built
from emulated import board, elf, image

REFILL = 3  # cycles after a taken branch, at most
# (least, most) by the beginning of the mnemonic, from the tables of the core's technical reference manual: the first
# that fits; n: registers in a list. What is in no row takes one cycle.
TABLE = (
    (r"ldr(\.w)?\tpc", (3, 5)),
    (r"pop.*pc\}|ldm.*pc\}", ("n+2", "n+4")),
    (r"pop|push|ldm|stm|vpush|vpop|vldm|vstm", ("n+1", "n+1")),
    (r"ldrd|strd", (2, 3)),
    (r"ldrex|strex", (2, 2)),
    (r"vldr\td|vstr\td|vldr\t\d|vldr(\.64)?\td", (2, 3)),
    (r"vldr|vstr", (1, 2)),
    (r"ldr|str|pld", (1, 2)),
    (r"bl|bx|b\.[nw]\t|b\t", (2, 4)),
    (r"(mov|add)(\.w)?\tpc", (2, 4)),
    (r"tbb|tbh", (3, 5)),
    (r"[us]div", (2, 12)),
    (r"mla|mls\t", (2, 2)),
    (r"vdiv|vsqrt", (14, 14)),
    (r"vn?ml[as]|vfn?m[as]", (3, 3)),
    (r"vmov\ts\d+, s\d+, r|vmov\tr\d+, r\d+|vmov\td\d+, r", (2, 2)),
    (r"it[te]*\t", (0, 1)),
    (r"dsb|isb|dmb|mrs|msr|nop\.w", (1, 4)),
)


def listed(arguments: str) -> int:
    """Registers in a list such as {r4, r5, s16-s18}; doubles count twice."""
    count = 0
    for part in re.search(r"\{(.*)\}", arguments)[1].split(","):  # type: ignore[index]
        kind, first, last = re.fullmatch(r"\s*([a-z]+)(\d*)(?:-[a-z]*(\d+))?\s*", part).groups()  # type: ignore[union-attr]
        registers = int(last) - int(first) + 1 if last else 1
        count += registers * (2 if kind == "d" else 1)
    return count


def expected(text: str) -> tuple[int, int]:
    """By the table."""
    plain = re.sub(r"^(v?[a-z]+)\.(f32|f64|32|64|s32\.f32|u32\.f32|f32\.s32|f32\.u32)", r"\1", text)
    for pattern, bounds in TABLE:
        if re.match(pattern, plain):
            least, most = (b if isinstance(b, int) else listed(text) + int(b[2:]) for b in bounds)
            return least, most
    return 1, 1


def instructions() -> list[tuple[int, int, str]]:
    """Both halves and text of each instruction of the joint's image."""
    words = ["arm-none-eabi-objdump", "-d", str(image(1))]
    listing = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    rows = re.findall(r"^ [0-9a-f]+:\t([0-9a-f]{4})(?: ([0-9a-f]{4}))? +\t([a-z].*)$", listing, re.MULTILINE)
    return [(int(first, 16), int(second or "0", 16), text) for first, second, text in rows]


def test_every_instruction_of_an_image_is_in_the_tables() -> None:
    library = built("tools/sim/boards/libcrux_emulated.so")
    seen = {}
    for first, second, text in instructions():
        conditional = re.match(r"b(eq|ne|cs|cc|mi|pl|vs|vc|hi|ls|ge|lt|gt|le)(\.[nw])?\t|cbn?z", text)
        wanted = (1, 1) if conditional else expected(text)  # a taken one is counted when it is taken
        assert crux_emulated.cycles(library, first, second) == wanted, (text, hex(first), hex(second))
        seen[text.split("\t")[0]] = True
    assert len(seen) > 80


@pytest.mark.parametrize(
    ("code", "least", "most"),
    [
        # nop; nop; nop; wfi: one word from flash, of four instructions
        ((0xBF00, 0xBF00, 0xBF00, 0xBF30), 4, 4 + 4),
        # adds r0, #1, eight of them, and wfi: three words. The first waits four; the others come while four are
        # executed.
        ((*[0x3001] * 8, 0xBF30), 9, 9 + 4),
        # movs r0, #3; again: subs r0, #1; bne again; wfi: taken twice, in a word that is there
        ((0x2003, 0x3801, 0xD1FD, 0xBF30), 1 + 3 * 2 + 2 + 1, 1 + 3 * 2 + 1 + 2 * REFILL + 4),
        # ldr r0, literal; vmov s0, r0; vadd s1, s0, s0; vadd s2, s2, s2; wfi: two words of code, of which the second
        # comes while three cycles are spent in the first, and one of data; one sum waits for what is moved, the other
        # does not
        ((0x4802, 0xEE00, 0x0A10, 0xEE70, 0x0A00, 0xEE31, 0x1A01, 0xBF30), 5, 6 + 1 + 4 + 1 + 4),
    ],
)
def test_small_programs_take_what_one_counts_by_hand(
    tmp_path: Path, code: tuple[int, ...], least: int, most: int
) -> None:
    file = tmp_path / "small.elf"
    # Vectors: stack, and the code behind them, at a multiple of eight bytes.
    file.write_bytes(elf(struct.pack(f"<II{len(code) + 1}H", 0x20018000, 0x08000009, *code, 0xE7FE)))
    with board(load_robot("scaler"), 0, 1, file) as emulated:
        emulated.measure(True)
        emulated.control(0.002, 0.0)
        cost = emulated.cost(crux_emulated.MAIN_LOOP)
        assert (cost.least_cycles, cost.most_cycles) == (least, most)
