"""Every name in the STM32 port's register header against the crates stm32-metapac and cortex-m: addresses, places of
bits, values of fields, interrupt numbers, pins. A name that this file does not place fails."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import metapac
import pytest
from crux_tools.paths import ROOT

PORT = ROOT / "firmware" / "ports" / "stm32g474"
HEADER = (PORT / "registers.h").read_text(encoding="utf-8")
DEFINED = re.findall(r"^#define (\w+)(\((?:\w+(?:, )?)+\))?[ \t]+(\S.*)$", HEADER, re.MULTILINE)
HELPERS = {"REGISTER", "REGISTER16", "BIT"}

INSTANCES = {"TIM": "TIM1", "ADC": "ADC1", "ADC12": "ADC12_COMMON", "GPIO": "GPIOA", "SPI": "SPI1", "FDCAN": "FDCAN1"}
ARRAYS = {"CCMR1": "ccmr_output[0]", "CCMR2": "ccmr_output[1]", "SMPR1": "smpr", "AFRL": "afr[0]", "AFRH": "afr[1]"}
ARRAYS |= {"RXF0S": "rxfs[0]", "RXF0A": "rxfa[0]"}
# Cortex-M core: block of the crate cortex-m, register, bytes from its start.
CORE = {
    "SYST_CSR": ("syst", "csr", 0),
    "SYST_RVR": ("syst", "rvr", 0),
    "SYST_CVR": ("syst", "cvr", 0),
    "NVIC_ISER0": ("nvic", "iser", 0),
    "NVIC_IPR4": ("nvic", "ipr", 16),
    "NVIC_IPR5": ("nvic", "ipr", 20),
    "SCB_VTOR": ("scb", "vtor", 0),
    "SCB_AIRCR": ("scb", "aircr", 0),
    "SCB_SHPR3": ("scb", "shpr", 8),
    "SCB_CPACR": ("scb", "cpacr", 0),
}
BASES = {"(adc)": ("ADC1", "ADC2"), "(port)": ("GPIOA", "GPIOB", "GPIOC"), "(can)": ("FDCAN1", "FDCAN2")}
# Registers that are made from a base: C expression, where it must lie.
OF_A_BASE = {
    "GPIOA": "GPIOA",
    "GPIOB": "GPIOB",
    "GPIOC": "GPIOC",
    "ADC1": "ADC1",
    "ADC2": "ADC2",
    "FDCAN1": "FDCAN1",
    "FDCAN2": "FDCAN2",
    "FDCAN1_RAM": "FDCANRAM1",
    "FDCAN2_RAM": "FDCANRAM2",
}
RAM_REGISTERS = {
    "FDCAN_FILTER(FDCAN{n}_RAM, 0)": "flssa[0]",
    "FDCAN_FILTER(FDCAN{n}_RAM, 27)": "flssa[27]",
    "*FDCAN_RX_FIFO0(FDCAN{n}_RAM, 0)": "rxfifo0[0]",
    "*FDCAN_RX_FIFO0(FDCAN{n}_RAM, 2)": "rxfifo0[36]",
    "*FDCAN_TX_BUFFER(FDCAN{n}_RAM, 0)": "txbuf[0]",
    "*FDCAN_TX_BUFFER(FDCAN{n}_RAM, 2)": "txbuf[36]",
}
# Bits and values: C expression, register, field, value (a number, a name of the crate, None: all bits of the field).
FIELDS = [
    ("FLASH_ACR_LATENCY_MASK", "FLASH.acr", "latency", None),
    ("FLASH_ACR_PREFETCH", "FLASH.acr", "prften", 1),
    ("FLASH_ACR_ICACHE", "FLASH.acr", "icen", 1),
    ("FLASH_ACR_DCACHE", "FLASH.acr", "dcen", 1),
    ("FLASH_ACR_DCRST", "FLASH.acr", "dcrst", 1),
    ("FLASH_SR_BSY", "FLASH.sr", "bsy", 1),
    ("FLASH_CR_PG", "FLASH.cr", "pg", 1),
    ("FLASH_CR_PER", "FLASH.cr", "per", 1),
    ("FLASH_CR_PNB(127)", "FLASH.cr", "pnb", None),
    ("FLASH_CR_BKER", "FLASH.cr", "bker", 1),
    ("FLASH_CR_STRT", "FLASH.cr", "strt", 1),
    ("FLASH_CR_LOCK", "FLASH.cr", "lock", 1),
    ("FLASH_ECCR_ECCD", "FLASH.eccr", "eccd", 1),
    ("FLASH_OPTR_DBANK", "FLASH.optr", "dbank", 1),
    ("RCC_CR_HSEON", "RCC.cr", "hseon", 1),
    ("RCC_CR_HSERDY", "RCC.cr", "hserdy", 1),
    ("RCC_CR_PLLON", "RCC.cr", "pllon", 1),
    ("RCC_CR_PLLRDY", "RCC.cr", "pllrdy", 1),
    ("RCC_CFGR_SW_PLL", "RCC.cfgr", "sw", "pll1_r"),
    ("RCC_CFGR_SWS_MASK", "RCC.cfgr", "sws", None),
    ("RCC_CFGR_SWS_PLL", "RCC.cfgr", "sws", "pll1_r"),
    ("RCC_CFGR_HPRE_MASK", "RCC.cfgr", "hpre", None),
    ("RCC_CFGR_HPRE_DIV2", "RCC.cfgr", "hpre", "div2"),
    ("RCC_PLLCFGR_SRC_HSE", "RCC.pllcfgr", "pllsrc", "hse"),
    ("RCC_PLLCFGR_M(6)", "RCC.pllcfgr", "pllm", "div6"),
    ("RCC_PLLCFGR_N(85)", "RCC.pllcfgr", "plln", "mul85"),
    ("RCC_PLLCFGR_REN", "RCC.pllcfgr", "pllren", 1),
    ("RCC_AHB2ENR_GPIOA", "RCC.ahb2enr", "gpioaen", 1),
    ("RCC_AHB2ENR_GPIOB", "RCC.ahb2enr", "gpioben", 1),
    ("RCC_AHB2ENR_GPIOC", "RCC.ahb2enr", "gpiocen", 1),
    ("RCC_AHB2ENR_ADC12", "RCC.ahb2enr", "adc12en", 1),
    ("RCC_APB1ENR1_FDCAN", "RCC.apb1enr1", "fdcanen", 1),
    ("RCC_APB1ENR1_PWR", "RCC.apb1enr1", "pwren", 1),
    ("RCC_APB2ENR_TIM1", "RCC.apb2enr", "tim1en", 1),
    ("RCC_APB2ENR_SPI1", "RCC.apb2enr", "spi1en", 1),
    ("RCC_CCIPR_FDCAN_PCLK1", "RCC.ccipr", "fdcansel", "pclk1"),
    ("IWDG_KR_RELOAD", "IWDG.kr", "key", "reset"),
    ("IWDG_KR_UNLOCK", "IWDG.kr", "key", "enable"),
    ("IWDG_KR_START", "IWDG.kr", "key", "start"),
    ("IWDG_PR_32", "IWDG.pr", "pr", "divide_by32"),
    ("GPIO_MODE_INPUT", "GPIOA.moder", "moder[0]", "input"),
    ("GPIO_MODE_OUTPUT", "GPIOA.moder", "moder[0]", "output"),
    ("GPIO_MODE_ALTERNATE", "GPIOA.moder", "moder[0]", "alternate"),
    ("GPIO_MODE_ANALOG", "GPIOA.moder", "moder[0]", "analog"),
    ("GPIO_PULL_UP", "GPIOA.pupdr", "pupdr[0]", "pull_up"),
    ("GPIO_PULL_DOWN", "GPIOA.pupdr", "pupdr[0]", "pull_down"),
    ("TIM_CR1_CEN", "TIM1.cr1", "cen", 1),
    ("TIM_CR1_CMS_BOTH", "TIM1.cr1", "cms", "center_aligned3"),
    ("TIM_CR2_OIS1N", "TIM1.cr2", "oisn[0]", 1),
    ("TIM_CR2_OIS2N", "TIM1.cr2", "oisn[1]", 1),
    ("TIM_CR2_OIS3N", "TIM1.cr2", "oisn[2]", 1),
    ("TIM_CR2_MMS2_UPDATE", "TIM1.cr2", "mms2", "update"),
    ("TIM_SR_BIF", "TIM1.sr", "bif[0]", 1),
    ("TIM_EGR_UG", "TIM1.egr", "ug", 1),
    ("TIM_CCMR1_OC1PE", "TIM1.ccmr_output[0]", "ocpe[0]", 1),
    ("TIM_CCMR1_OC1M_PWM1", "TIM1.ccmr_output[0]", "ocm[0]", "pwm_mode1"),
    ("TIM_CCMR1_OC2PE", "TIM1.ccmr_output[0]", "ocpe[1]", 1),
    ("TIM_CCMR1_OC2M_PWM1", "TIM1.ccmr_output[0]", "ocm[1]", "pwm_mode1"),
    ("TIM_CCMR2_OC3PE", "TIM1.ccmr_output[1]", "ocpe[0]", 1),
    ("TIM_CCMR2_OC3M_PWM1", "TIM1.ccmr_output[1]", "ocm[0]", "pwm_mode1"),
    *((f"TIM_CCER_CC{n}E", "TIM1.ccer", f"cce[{n - 1}]", 1) for n in (1, 2, 3)),
    *((f"TIM_CCER_CC{n}NE", "TIM1.ccer", f"ccne[{n - 1}]", 1) for n in (1, 2, 3)),
    ("TIM_BDTR_DTG(85)", "TIM1.bdtr", "dtg", 85),
    ("TIM_BDTR_OSSI", "TIM1.bdtr", "ossi", "idle_level"),
    ("TIM_BDTR_OSSR", "TIM1.bdtr", "ossr", "idle_level"),
    ("TIM_BDTR_BKE", "TIM1.bdtr", "bke[0]", 1),
    ("TIM_BDTR_AOE", "TIM1.bdtr", "aoe", 1),
    ("TIM_BDTR_MOE", "TIM1.bdtr", "moe", 1),
    ("TIM_BDTR_BKF(4UL)", "TIM1.bdtr", "bkf[0]", "fdts_div2_n6"),
    ("ADC_ISR_ADRDY", "ADC1.isr", "adrdy", 1),
    ("ADC_IER_JEOCIE", "ADC1.ier", "jeocie", 1),
    ("ADC_CR_ADEN", "ADC1.cr", "aden", 1),
    ("ADC_CR_ADSTART", "ADC1.cr", "adstart", 1),
    ("ADC_CR_JADSTART", "ADC1.cr", "jadstart", 1),
    ("ADC_CR_ADVREGEN", "ADC1.cr", "advregen", 1),
    ("ADC_CR_ADCAL", "ADC1.cr", "adcal", 1),
    ("ADC_SMPR1_SMP(4UL, ADC_SAMPLE_12_CYCLES)", "ADC1.smpr", "smp[4]", "cycles12_5"),
    ("ADC_SMPR1_SMP(9UL, ADC_SAMPLE_247_CYCLES)", "ADC1.smpr", "smp[9]", "cycles247_5"),
    ("ADC_SQR1_SQ1(4UL)", "ADC1.sqr1", "sq[0]", 4),
    ("ADC_JSQR_JEXTSEL_TIM1_TRGO2", "ADC1.jsqr", "jextsel", 8),  # RM0440's table of injected triggers
    ("ADC_JSQR_JEXTEN_RISING", "ADC1.jsqr", "jexten", "rising_edge"),
    ("ADC_JSQR_JSQ1(2UL)", "ADC1.jsqr", "jsq[0]", 2),
    ("ADC12_CCR_CKMODE_HCLK_4", "ADC12_COMMON.ccr", "ckmode", "sync_div4"),
    ("SPI_CR1_CPHA", "SPI1.cr1", "cpha", "second_edge"),
    ("SPI_CR1_MSTR", "SPI1.cr1", "mstr", "master"),
    ("SPI_CR1_BR_32", "SPI1.cr1", "br", "div32"),
    ("SPI_CR1_SPE", "SPI1.cr1", "spe", 1),
    ("SPI_CR1_SSI", "SPI1.cr1", "ssi", 1),
    ("SPI_CR1_SSM", "SPI1.cr1", "ssm", 1),
    ("SPI_CR2_DS_16", "SPI1.cr2", "ds", "bits16"),
    ("SPI_SR_RXNE", "SPI1.sr", "rxne", 1),
    ("FDCAN_CCCR_INIT", "FDCAN1.cccr", "init", 1),
    ("FDCAN_CCCR_CCE", "FDCAN1.cccr", "cce", 1),
    ("FDCAN_CCCR_FDOE", "FDCAN1.cccr", "fdoe", 1),
    ("FDCAN_CCCR_BRSE", "FDCAN1.cccr", "brse", 1),
    ("FDCAN_PSR_BO", "FDCAN1.psr", "bo", 1),
    ("FDCAN_DBTP_TDC", "FDCAN1.dbtp", "tdc", 1),
    ("FDCAN_IR_RF0N", "FDCAN1.ir", "rfn[0]", 1),
    ("FDCAN_RXGFC_STANDARD_FILTERS(1)", "FDCAN1.rxgfc", "lss", 1),
    ("FDCAN_TXFQS_FULL", "FDCAN1.txfqs", "tfqf", 1),
]
# Where the crate errs: the reference manual RM0440 and ST's own headers have R1MODE in bit 8.
CRATE_ERRS = {"PWR_CR5_R1MODE": (1 << 8, "PWR.cr5", "r1mode")}
FLASH_ERRORS = (
    "operr", "progerr", "wrperr", "pgaerr", "sizerr", "pgserr", "miserr", "fasterr", "rderr", "optverr",
)  # fmt: skip
# Values that span several fields: each must be the sum.
SUMS = [
    ("FDCAN_RXGFC_REJECT_REMOTE", "FDCAN1.rxgfc", {"rrfe": 1, "rrfs": 1}),
    ("FDCAN_RXGFC_REJECT_OTHERS", "FDCAN1.rxgfc", {"anfe": 2, "anfs": 2}),
    ("FLASH_SR_ERRORS", "FLASH.sr", dict.fromkeys(FLASH_ERRORS, 1)),
]
# Not registers: fields of a filter and length of an element in the FDCAN's message RAM, checked by what lies there.
OTHERS = {"FDCAN_FILTER_TWO_IDS_TO_FIFO0", "FDCAN_ELEMENT_WORDS", "ADC_SAMPLE_12_CYCLES", "ADC_SAMPLE_247_CYCLES"}
OTHERS |= {"FDCAN_FILTER", "FDCAN_RX_FIFO0", "FDCAN_TX_BUFFER"}


def is_register(body: str) -> bool:
    return body.startswith("REGISTER")


def expected_address(name: str, base: str | None) -> int:
    """Where a register macro must point; `base`: the instance given to it."""
    if name in CORE:
        block, register, offset = CORE[name]
        return metapac.core(block)[register] + offset
    prefix, register = name.split("_", 1)
    known = metapac.registers(base or INSTANCES.get(prefix, prefix))
    plain = register.lower()
    number = re.fullmatch(r"(\w+?)(\d)", plain)
    names = [ARRAYS.get(register, plain), f"{plain}16"]  # a data register has one name for each width
    if number is not None:
        names.append(f"{number.group(1)}[{int(number.group(2)) - 1}]")
    places = [known[n].address for n in names if n in known]
    assert places, f"{name}: the chip has {', '.join(known)}"
    return places[0]


def addresses() -> dict[str, int]:
    """Expected address by C expression, of all registers in the header."""
    found = {}
    for name, arguments, body in DEFINED:
        if name in OTHERS | HELPERS or not is_register(body):
            continue
        bases = BASES.get(arguments, (None,))
        for base in bases:
            found[f"{name}({base})" if base else name] = expected_address(name, base)
    return found | {
        expression.format(n=n): metapac.registers(f"FDCANRAM{n}")[name].address
        for expression, name in RAM_REGISTERS.items()
        for n in (1, 2)
    }


def field_values() -> dict[str, int]:
    """Expected value by C expression."""
    found = {}
    for expression, where, name, value in FIELDS:
        peripheral, register = where.split(".")
        field = metapac.registers(peripheral)[register].fields[name]
        number = field.variants[value] if isinstance(value, str) else value
        found[expression] = field.mask if number is None else field.word(number)
    for expression, where, parts in SUMS:
        peripheral, register = where.split(".")
        fields = metapac.registers(peripheral)[register].fields
        found[expression] = sum(fields[name].word(value) for name, value in parts.items())
    for expression, (right, where, name) in CRATE_ERRS.items():
        peripheral, register = where.split(".")
        assert metapac.registers(peripheral)[register].fields[name].mask != right, (
            f"{expression}: the crate is right now"
        )
        found[expression] = right
    found |= {name: metapac.peripherals()[instance]["address"] for name, instance in OF_A_BASE.items()}
    found |= {f"IRQ_{name}": metapac.interrupts()[name] for name in ("ADC1_2", "FDCAN1_IT0")}
    # RM0440, FLASH_KEYR: the two words that unlock it.
    found |= {"FLASH_KEY_1": 0x45670123, "FLASH_KEY_2": 0xCDEF89AB}
    # PM0214, AIRCR: what is written without the key in the upper half is lost.
    found |= {"SCB_AIRCR_KEY": 0x05FA << 16, "SCB_AIRCR_SYSRESETREQ": 1 << 2}
    # RM0440, FDCAN message RAM: a standard filter is SFT (31:30, 1: two ids), SFEC (29:27, 1: into FIFO 0), two ids.
    found["FDCAN_FILTER_TWO_IDS_TO_FIFO0(0x7FFUL, 0x123UL)"] = 1 << 30 | 1 << 27 | 0x7FF << 16 | 0x123
    return found


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> dict[str, int]:
    """What the C compiler makes of each expression: address of a register, value of anything else."""
    registers, values = list(addresses()), list(field_values())
    lines = [f'  printf("%llu\\n", (unsigned long long)(uintptr_t)&({expression}));' for expression in registers]
    lines += [f'  printf("%llu\\n", (unsigned long long)({expression}));' for expression in values]
    folder = tmp_path_factory.mktemp("registers")
    source = folder / "registers.c"
    program = '#include <stdio.h>\n#include "registers.h"\nint main(void) {\n' + "\n".join(lines) + "\n  return 0;\n}\n"
    source.write_text(program, encoding="utf-8")
    # For the host: the addresses fit its pointers.
    subprocess.run(["cc", "-w", f"-I{PORT}", str(source), "-o", str(folder / "registers")], check=True)
    run = subprocess.run([str(folder / "registers")], check=True, capture_output=True, text=True)
    return dict(zip(registers + values, map(int, run.stdout.split()), strict=True))


def differences(compiled: dict[str, int], expected: dict[str, int]) -> list[str]:
    return [f"{e}: {compiled[e]:#x}, should be {v:#x}" for e, v in expected.items() if compiled[e] != v]


def test_registers_lie_where_the_chip_has_them(compiled: dict[str, int]) -> None:
    assert differences(compiled, addresses()) == []


def test_bits_and_values_are_the_chips(compiled: dict[str, int]) -> None:
    assert differences(compiled, field_values()) == []


def test_no_name_of_the_header_is_left_out() -> None:
    covered = {re.split(r"[(]", expression.lstrip("*"))[0] for expression in (*addresses(), *field_values())}
    assert {name for name, _, _ in DEFINED} - covered - OTHERS - HELPERS == set()


def test_pins_carry_the_functions_the_board_gives_them() -> None:
    rows = re.findall(r"\{GPIO([A-C]), (\d+)UL, (\d+)UL\},\s*// (\w+?)_(\w+)", (PORT / "board.c").read_text())
    assert len(rows) >= 12
    for port, pin, function, peripheral, signal in rows:
        found = [p["af"] for p in metapac.peripherals()[peripheral]["pins"]
                 if p["pin"] == f"P{port}{pin}" and p["signal"] == signal]  # fmt: skip
        assert found == [int(function)], f"P{port}{pin} {peripheral}_{signal}"
    for pin, peripheral, signal in (("PA0", "ADC1", "IN1"), ("PA1", "ADC2", "IN2"), ("PA2", "ADC1", "IN3"),
                                    ("PA3", "ADC1", "IN4")):  # fmt: skip
        assert {"pin": pin, "signal": signal, "af": None} in metapac.peripherals()[peripheral]["pins"]


def test_the_lock_file_pins_the_crate() -> None:
    lock = Path(metapac.MANIFEST).with_name("Cargo.lock").read_text(encoding="utf-8")
    entry = re.search(r'name = "stm32-metapac"\nversion = "(.*)"\nsource = ".*"\nchecksum = "(\w{64})"', lock)
    assert entry is not None
    assert entry.group(1) in (metapac.MANIFEST).read_text(encoding="utf-8")
