"""Certificates: a claim about a scenario with what shows it, as one JSON file, and whether it is shown.

| key | what |
| --- | --- |
| crux_certificate | 1 |
| claim | `no plan`: `crux check` accepts none for the scenario; |
| | `bound`: none of `steps` steps that it accepts costs less than `bound`, J (6) with the scenario's weights |
| scenario_yaml, robot, robot_sha256 | what the claim is about |
| multipliers | of `no plan`: [{grips: [[hold, faces], ...], of: [[6 numbers], ...]}, ...] |
| | of `bound`: [{knot: a knot or null for all, of: [[6 numbers], ...]}, ...], of force and moment about W's origin |
| steps, bound | of `bound` |
| sha256 | of all the rest, as `digest` writes it |

Nothing in it is trusted: all rows are built anew from scenario and robot, and any multipliers give true statements.
"""

import hashlib
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from crux_contracts.robot import Robot, load_robot, robot_names
from crux_contracts.scenario import Scenario, ScenarioError, parse_scenario

from crux_planner.checker.cheapest_way import CheapestWay
from crux_planner.checker.geometry import Array
from crux_planner.checker.no_way import NotShownError, NoWay
from crux_planner.checker.outer import OutsideError

NO_PLAN, BOUND = "no plan", "bound"
Shown = list[tuple[int | None, list[Array]]]
UNKNOWN = (
    "about a walk, limbs in the air at the start, bounded surfaces, or bodies that lean: "
    "no certificates are known for these"
)
LONGEST_SHOWN = 80
LARGEST = 1e9
"""Multipliers beyond it would overflow in what they show of no plan; they are taken to show nothing."""
_SIDES = {"start": "from the start", "goal": "from the goal back"}


class CertificateError(ValueError):
    """The file is no certificate, or does not show its claim."""


def is_certificate(path: Path) -> bool:
    """Whether a file is meant as one; plans begin with another byte. OSError where it cannot be read."""
    with path.open("rb") as file:
        return file.read(1) == b"{"


def digest(document: dict[str, Any]) -> str:
    """SHA-256 of all but itself: keys sorted, no spaces."""
    rest = {key: value for key, value in document.items() if key != "sha256"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def of_no_plan(search: NoWay, robot: Robot) -> dict[str, Any]:
    """The certificate of a search that has ended."""
    names = [list(offer.name) for offer in search.offers]
    shown = [
        {"grips": [names[g] for g in grips], "of": [each.tolist() for each in multipliers]}
        for grips, multipliers in search.shown.items()
        if multipliers
    ]
    return sealed(NO_PLAN, search.scenario, robot, multipliers=shown)


def of_bound(way: CheapestWay, robot: Robot, shown: Shown, most: float) -> dict[str, Any]:
    """The certificate of what multipliers show, by knot or for all (None), up to `most`; `way` has been shown them."""
    bound = float(np.floor(1e4 * (min(way.least(), most) - 1e-5)) / 1e4)  # so that rounding elsewhere does no harm
    entries = [{"knot": knot, "of": [each.tolist() for each in multipliers]} for knot, multipliers in shown]
    return sealed(BOUND, way.scenario, robot, steps=way.steps, bound=bound, multipliers=entries)


def sealed(claim: str, scenario: Scenario, robot: Robot, **more: Any) -> dict[str, Any]:
    """A claim with its digest."""
    about = {"scenario_yaml": scenario.yaml_text, "robot": robot.name, "robot_sha256": robot.hash}
    document = {"crux_certificate": 1, "claim": claim, **about, **more}
    return {**document, "sha256": digest(document)}


def read(path: Path) -> dict[str, Any]:
    """Raises CertificateError and OSError."""
    try:
        document = json.loads(path.read_bytes())
    except ValueError as error:
        raise CertificateError(f"no whole JSON file: {error}") from None
    except RecursionError:
        raise CertificateError("not of the form of a certificate: nested too deeply") from None
    if not isinstance(document, dict) or document.get("crux_certificate") != 1:
        raise CertificateError("no certificate of a version that is known here (1)")
    if digest(document) != document.get("sha256"):
        raise CertificateError("damaged: its content is not that of its sha256")
    return document


def verify(document: dict[str, Any]) -> tuple[Scenario, str]:
    """The scenario and what is shown about it. Raises CertificateError."""
    try:
        if document["robot"] not in robot_names():
            raise CertificateError(f"robot {document['robot']!r}: expected one of {', '.join(robot_names())}")
        robot = load_robot(document["robot"])
        if robot.hash != document["robot_sha256"]:
            raise CertificateError(f"about another {robot.name} than is known here")
        if not isinstance(document["scenario_yaml"], str):
            raise CertificateError(f"scenario_yaml: {_shown(document['scenario_yaml'])}: expected a text")
        scenario = parse_scenario(document["scenario_yaml"], "the scenario in the certificate")
        if scenario.contact.model != "patch" or scenario.start.air or scenario.not_upright:
            raise CertificateError(UNKNOWN)
        verifiers = {NO_PLAN: _verify_no_plan, BOUND: _verify_bound}
        if document["claim"] not in verifiers:
            raise CertificateError(f"claim {document['claim']!r}: expected {NO_PLAN!r} or {BOUND!r}")
        return scenario, verifiers[document["claim"]](document, scenario, robot)
    except (KeyError, TypeError, IndexError) as error:
        raise CertificateError(f"not of the form of a certificate: {error!r}") from None
    except (ScenarioError, OutsideError) as error:
        raise CertificateError(str(error)) from None
    except NotShownError as error:
        raise CertificateError(f"does not show its claim: {error}") from None


def _verify_no_plan(document: dict[str, Any], scenario: Scenario, robot: Robot) -> str:
    search = NoWay(scenario, robot)
    number: dict[tuple[str, ...], int] = {offer.name: g for g, offer in enumerate(search.offers)}
    for pairs, multipliers in _entries(document, "grips"):
        is_form = isinstance(pairs, list) and all(isinstance(pair, list) for pair in pairs)
        names = [tuple(map(str, pair)) for pair in pairs] if is_form else [()]
        if not all(name in number for name in names):
            raise CertificateError(f"multipliers for {_shown(pairs)}: no such grips")
        grips = [number[name] for name in names]
        search.shown[tuple(sorted(grips))] = [each for each in multipliers if np.abs(each).max() <= LARGEST]
    side, count = search.prove()
    ends = f"{_SIDES[side]} {count} sets of grips can be had, and none of them leads to the other end"
    return f"no plan that crux check accepts: {ends}"


def _verify_bound(document: dict[str, Any], scenario: Scenario, robot: Robot) -> str:
    steps, bound = document["steps"], document["bound"]
    if type(steps) is not int or type(bound) not in (int, float) or not np.isfinite(bound):
        raise CertificateError("not of the form of a certificate: steps and bound are numbers")
    entries = _entries(document, "knot")
    for knot, _ in entries:
        if knot is not None and (type(knot) is not int or not 0 <= knot < steps):
            raise CertificateError(f"multipliers at knot {_shown(knot)}: expected one before the last, {steps}")
    way = CheapestWay(scenario, robot, steps)
    for knot, multipliers in entries:
        for each in multipliers:
            way.show(knot, each)
        if knot is None:
            way.drop(bound)
    least = way.least()
    if least < bound:
        raise NotShownError(f"what it has shows that none of {steps} steps costs less than {least:.4f}, not {bound}")
    which = f"no plan of {steps} steps that crux check accepts costs less than {bound:.4f}"
    return f"bound: {which}, whatever its grips, swings and body motion"


def _entries(document: dict[str, Any], key: str) -> list[tuple[Any, list[Array]]]:
    """What multipliers are about, by `key`, with them; (6,) each. Raises CertificateError."""
    entries = document["multipliers"]
    if not isinstance(entries, list):
        raise CertificateError(f"multipliers: {_shown(entries)}: expected a list")
    for each in entries:
        if not isinstance(each, dict) or key not in each or not isinstance(each.get("of"), list):
            raise CertificateError(f"multipliers: {_shown(each)}: expected {key} and of, a list of six numbers each")
    return [(each[key], [vector(numbers) for numbers in each["of"]]) for each in entries]


def vector(numbers: Any) -> Array:
    """(6,) finite numbers. Raises CertificateError."""
    most = sys.float_info.max
    if not isinstance(numbers, list) or len(numbers) != 6:
        raise CertificateError(f"multipliers {_shown(numbers)}: expected a list of six numbers")
    for number in numbers:
        if type(number) not in (int, float) or not -most <= number <= most:
            raise CertificateError(f"multipliers {_shown(numbers)}: {_shown(number)}: expected a finite number")
    return np.array(numbers, dtype=float)


def _shown(value: Any) -> str:
    """As the file has it, short enough for a message."""
    text = json.dumps(value)
    return text if len(text) <= LONGEST_SHOWN else f"{text[: LONGEST_SHOWN - 3]}..."
