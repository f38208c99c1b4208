from __future__ import annotations

import re
from pathlib import Path

import pytest
from crux_contracts.scenario import ScenarioError, load_scenario, parse_scenario
from scenario_texts import GOOD_TEXT, POINT_TEXT

SCENARIOS = sorted((Path(__file__).resolve().parents[2] / "msgs" / "scenarios").glob("*.yaml"))


def test_every_value_is_read() -> None:
    s = parse_scenario(GOOD_TEXT)
    assert (s.name, s.robot, s.wall.slope_deg, s.wall.friction) == ("good", "scaler", 45, 0.6)
    assert (s.contact.model, s.contact.max_normal_N, s.contact.spine_twist_Nm) == ("patch", 60, 0.05)
    assert s.contact.spines_only == {"RF": 2}
    assert s.holds[1].friction == (2.2, 2.1, 0.0, 0.0, 2.0)
    assert s.holds[1].spines == (True, True, False, False, True)
    assert s.holds[2].spines == (False,) * 5
    assert s.holds[0].friction == (2.2,) * 5
    assert [c.name for c in s.cuboids] == ["a", "b", "c", "d", "pillar"]
    assert s.holds[1].yaw_rad == pytest.approx(0.20943951)
    assert s.start.grasps["RF"].hold == "b"
    assert s.start.grasps["RF"].faces == "y"
    assert s.goal.body.rpy_rad[2] == pytest.approx(0.0872664626)
    assert (s.goal.tolerance_m, s.goal.body.tolerance_deg) == (0.02, 2)
    assert (s.horizon.steps, s.horizon.duration_s) == (40, 80)
    assert (s.planner.method, s.planner.rho, s.planner.iterations) == ("multi_block", 10, 5)
    assert (s.planner.weights, s.planner.margins) == ({"lift": 2}, {"friction": 0.1})
    assert s.planner.limit_surface == "inner"
    assert s.hold_index("d") == 3
    assert s.yaml_text == GOOD_TEXT


def test_defaults_are_the_documented_ones() -> None:
    s = parse_scenario(POINT_TEXT)
    assert s.wall.friction == 0.6
    assert (s.contact.patch_radius_m, s.contact.max_normal_N) == (0.02, 60)
    assert (s.contact.spine_shear_N, s.contact.spine_twist_Nm, s.contact.spines_only) == (0, 0, {})
    assert (s.holds, s.obstacles, s.goal.grasps) == ((), (), {})
    assert s.start.body.rpy_deg == (0, 0, 0)
    assert (s.goal.tolerance_m, s.goal.body.tolerance_deg) == (0.01, 3)
    assert (s.planner.method, s.planner.rho) == ("auto", None)
    assert s.planner.limit_surface == "cone"
    assert s.start.feet["RR"] == (-0.1, -0.3)


@pytest.mark.parametrize(("slope", "x", "z"), [(0, 0, -9.81), (90, -9.81, 0), (30, -4.905, -8.495709)])
def test_gravity_points_down_the_slope(slope: float, x: float, z: float) -> None:
    s = parse_scenario(GOOD_TEXT.replace("slope_deg: 45", f"slope_deg: {slope}"))
    assert s.wall.gravity_w_m_s2 == pytest.approx((x, 0, z), abs=1e-6)


def test_yaml_1_2_numbers_and_words() -> None:
    s = parse_scenario(GOOD_TEXT.replace("friction: 0.6", "friction: 6e-1").replace("name: good", "name: yes"))
    assert s.wall.friction == 0.6
    assert s.name == "yes"


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda p: p.stem)
def test_scenarios_that_ship_are_right_and_named_like_their_file(path: Path) -> None:
    assert load_scenario(path).name == path.stem


# What is written wrong, and what the one message has to say.
BROKEN = {
    "unknown key": ("friction: 0.6}", "fricton: 0.6}", r":4: wall\.fricton: unknown key; did you mean friction\?"),
    "unknown top key": ("horizon:", "horizont: 1\nhorizon:", r":25: horizont: unknown key; did you mean horizon\?"),
    "millimetres": (
        "[0.14, 0.36]",
        "[140, 0.36]",
        r"holds\[0\]\.position_m\[0\]: 140: .* looks like millimetres: 0.14\?",
    ),
    "body in millimetres": (
        "0.185], rpy_deg: [0, 0, 0]",
        "185]",
        r"start\.body\.position_m\[2\]: 185: .*millimetres: 0.185",
    ),
    "body in centimetres": ("0.185], rpy_deg: [0, 0, 0]", "18.5]", r"position_m\[2\]: 18.5: .*millimetres: 0.0185"),
    "size in millimetres": (
        "size_m: [0.06, 0.06, 0.2]",
        "size_m: [0.06, 0.06, 200]",
        r"obstacles\[0\]\.size_m\[2\]: 200: ",
    ),
    "finger of no limb": ("{RF: 2}", "{FR: 2}", r"spines_only\.FR: unknown key; expected LF, RF, LR or RR"),
    "third finger": ("{RF: 2}", "{RF: 3}", r"contact\.spines_only\.RF: 3: expected a whole number in 1\.\.2"),
    "hanging without spines": (
        "spine_shear_N: 5, ",
        "",
        r"contact\.spines_only: .*there are no spines to hang on by: give contact\.spine_shear_N",
    ),
    "not a number": (
        "slope_deg: 45",
        "slope_deg: steep",
        r'wall\.slope_deg: "steep": expected a number in 0..180 degrees',
    ),
    "quoted number": ("slope_deg: 45", 'slope_deg: "45"', r'wall\.slope_deg: "45": expected a number'),
    "true for a number": ("slope_deg: 45", "slope_deg: true", r"wall\.slope_deg: true: expected a number"),
    "nan": ("friction: 0.6", "friction: .nan", r"wall\.friction: \.nan: is not a finite number"),
    "infinite": ("friction: 0.6", "friction: -.inf", r"wall\.friction: -\.inf: is not a finite number"),
    "enormous": (
        "steps: 40",
        "steps: " + "9" * 5000,
        r"horizon\.steps: 9{57}\.\.\.: expected a whole number in 1..1000",
    ),
    "beyond a ceiling": (
        "slope_deg: 45",
        "slope_deg: 200",
        r"wall\.slope_deg: 200: expected a number in 0..180 degrees",
    ),
    "negative force": ("max_normal_N: 60", "max_normal_N: -1", r"contact\.max_normal_N: -1: expected a number above 0"),
    "zero force": ("max_normal_N: 60", "max_normal_N: 0", r"contact\.max_normal_N: 0: expected a number above 0"),
    "wrong model": ("model: patch", "model: magnet", r'contact\.model: "magnet": expected patch or point'),
    "fraction of a step": ("steps: 40", "steps: 40.5", r"horizon\.steps: 40\.5: expected a whole number"),
    "zero time": ("dt_s: 2.0", "dt_s: 0", r"horizon\.dt_s: 0: expected a number in 0.01..20 s"),
    "too few numbers": (
        "[0.14, 0.36]",
        "[0.14]",
        r"holds\[0\]\.position_m: a list of 1: expected a list of 2 numbers in m",
    ),
    "no list": ("[0.14, 0.36]", "0.14", r"holds\[0\]\.position_m: 0\.14: expected a list of 2 numbers in m"),
    "missing key": ("name: good\n", "", r": name: is missing"),
    "missing value": ("name: good\n", "name:\n", r"name: nothing: expected a text"),
    "number for a name": ("name: good\n", "name: 45\n", r'name: 45: expected a text: "45"'),
    "missing limb": (", RR: {hold: d, faces: x}", "", r"start\.grasps\.RR: is missing"),
    "unknown limb": ("RR: {hold: d", "RB: {hold: d", r"start\.grasps\.RB: unknown key"),
    "wrong faces": ("{hold: a, faces: x}", "{hold: a, faces: z}", r'grasps\.LF\.faces: "z": expected x or y'),
    "missing hold": (
        "{hold: a, faces: x}",
        "{hold: q, faces: x}",
        r'start\.grasps\.LF\.hold: "q": no such hold; expected a, b',
    ),
    "grasp on an obstacle": ("{hold: a,", "{hold: pillar,", r'LF\.hold: "pillar": is an obstacle'),
    "two limbs on a hold": (
        "{hold: a, faces: x}",
        "{hold: b, faces: x}",
        r'RF\.hold: "b": expected a hold of its own for RF; LF',
    ),
    "missing goal hold": (
        "LF: {hold: c",
        "LF: {hold: cc",
        r'goal\.grasps\.LF\.hold: "cc": no such hold; did you mean c\?',
    ),
    "overlap": (
        "[-0.14, 0.36]",
        "[0.17, 0.38]",
        r'holds\[2\]\.position_m: .*"c" overlaps "a" \(holds\[0\], line 8\) by 0\.03 m',
    ),
    "overlapping obstacle": ("[0.56, 0.36]", "[0.15, 0.37]", r'obstacles\[0\]\.position_m: .*"pillar" overlaps "a"'),
    "two of a name": ("name: c,", "name: a,", r"holds\[2\]\.name: .*expected a name of its own; line 8 has it too"),
    "half a friction map": ("+y: 0.0, ", "", r"holds\[1\]\.friction\.\+y: is missing"),
    "unknown face": ("+x: 2.2, ", "+x: 2.2, +z: 1, ", r"holds\[1\]\.friction\.\+z: unknown key"),
    "spines of a word": ("spines: false}", "spines: no}", r'holds\[2\]\.spines: "no": expected true or false'),
    "unknown robot": ("robot: scaler", "robot: scalar", r'robot: "scalar": no such folder .*did you mean scaler\?'),
    "robot outside": ("robot: scaler", "robot: ../scaler", r'robot: "\.\./scaler": no such folder'),
    "wrong version": ("version: 1", "version: 3", r"version: 3: this crux reads scenario versions 1 and 2"),
    "version missing": ("version: 1\n", "", r"version: is missing"),
    "feet with patches": (
        "  grasps: {LF: {hold: a",
        "  feet: {LF: {hold: a",
        r"start\.feet: does not go with contact\.model patch",
    ),
    "unknown weight": (
        "{lift: 2}",
        "{height: 2}",
        r"planner\.weights\.height: unknown key; expected body, position, orientation, velocity, wrench, lift",
    ),
    "unknown limit surface": (
        "limit_surface: inner",
        "limit_surface: ball",
        r'limit_surface: "ball": expected cone, inner or paper',
    ),
    "unknown method": ("multi_block", "best", r'planner\.method: "best": expected auto, two_block'),
    "duplicate key": (
        "robot: scaler",
        "robot: scaler\nrobot: scaler",
        r":4: robot: this key stands here twice, first in line 3",
    ),
    "anchor": ("robot: scaler", "robot: &r scaler", r":3: robot: anchors and aliases"),
    "tag": ("robot: scaler", "robot: !!python/name:os.system scaler", r"tags \(!\) are not allowed"),
    "two documents": ("horizon:", "---\nhorizon:", r"expected one document only"),
    "unbalanced": ("[0.14, 0.36]", "[0.14, 0.36", r"is not YAML: "),
    "tab": ("  body: {position_m: [0.0", "\tbody: {position_m: [0.0", r"is not YAML: "),
    "list as key": ("robot: scaler", "[robot]: scaler", r"expected a plain word as key"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_one_clear_message_for_a_broken_scenario(case: str) -> None:
    right, wrong, says = BROKEN[case]
    assert right in GOOD_TEXT, "the case does not change the text"
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(GOOD_TEXT.replace(right, wrong, 1), "wall.yaml")
    text = str(caught.value)
    assert re.search(says, text), text
    assert all(line.startswith("wall.yaml") for line in text.splitlines())
    assert caught.value.path == "wall.yaml"
    assert "Traceback" not in text


@pytest.mark.parametrize(
    ("right", "pasted", "says"),
    [
        ("[0.14, 0.36]", "[\u22120.14, 0.36]", "U+2212 MINUS SIGN is in it: write an ASCII '-'"),
        ("friction: 2.2", "friction: {\u2212x: 2.2}", "U+2212 MINUS SIGN is in it: write an ASCII '-'"),
        ("robot: scaler", "robot:\u00a0scaler", "U+00A0 NO-BREAK SPACE is in it: write an ASCII space"),
        ("  body: {", "\u00a0 body: {", "U+00A0 NO-BREAK SPACE is in it: write an ASCII space"),
        ("slope_deg: 45", "slope_deg: \u200b45", "U+200B ZERO WIDTH SPACE is in it: leave it out"),
        ("version: 1", "version: \u201c1\u201d", "U+201C LEFT DOUBLE QUOTATION MARK is in it: write an ASCII '\"'"),
    ],
)
def test_a_sign_pasted_from_a_page_is_named(right: str, pasted: str, says: str) -> None:
    assert right in GOOD_TEXT, "the case does not change the text"
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(GOOD_TEXT.replace(right, pasted, 1))
    assert str(caught.value).splitlines()[0].endswith(says)


def test_letters_of_other_languages_are_no_pasted_signs() -> None:
    with pytest.raises(ScenarioError, match="caf\u00e9") as caught:
        parse_scenario(GOOD_TEXT.replace("robot: scaler", "robot: caf\u00e9"))
    assert "U+" not in str(caught.value)


def test_the_first_problem_is_given_in_parts() -> None:
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(GOOD_TEXT.replace("slope_deg: 45", "slope_deg: 200"))
    error = caught.value
    assert (error.key, error.value, error.expected) == ("wall.slope_deg", "200", "expected a number in 0..180 degrees")


def test_all_problems_are_listed_in_the_order_of_the_file_but_not_too_many() -> None:
    holds = "".join(
        f"  - {{name: h{i}, position_m: [{0.3 * i:g}, 0.0], size_m: [0, 0, 0], friction: 1}}\n" for i in range(60)
    )
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(
            GOOD_TEXT.replace("slope_deg: 45", "slope_deg: -1").replace("obstacles:\n", f"{holds}obstacles:\n")
        )
    lines = str(caught.value).splitlines()
    assert "slope_deg" in lines[0]
    assert len(lines) == 21
    assert lines[-1].endswith("and 41 problems more")


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "is empty"),
        (b"\n\n# only a comment\n", "is empty"),
        (b"null\n", "is empty"),
        (b"- a\n- b\n", "a list of 2: expected a mapping"),
        (b"hello\n", "expected a mapping of keys to values"),
        (b"\xff\xfe\x00", "is not UTF-8 text"),
        (b"a: \x00\n", "is not YAML"),
        (b"[" * 100_000, "nested deeper than 16 levels"),
        (b"a: {" * 5000, "nested deeper than 16 levels"),
        (b"x" * 1_000_001, "1000001 bytes: expected at most 1000000 bytes"),
        (b"\x89MCAP0\r\n", "is not UTF-8 text"),
    ],
)
def test_files_that_are_no_scenario(data: bytes, says: str) -> None:
    with pytest.raises(ScenarioError, match=re.escape(says)):
        parse_scenario(data)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="no such file"):
        load_scenario(tmp_path / "none.yaml")
    with pytest.raises(ScenarioError, match="is a folder"):
        load_scenario(tmp_path)
    with pytest.raises(ScenarioError, match="is not a file"):
        load_scenario("/dev/zero")
    huge = tmp_path / "huge.yaml"
    with huge.open("wb") as file:
        file.truncate(10**12)  # sparse: reading it would take all memory
    with pytest.raises(ScenarioError, match="expected at most 1000000 bytes"):
        load_scenario(huge)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("feet: {LF: [0.1, 0.3], ", "feet: {"), r"start\.feet\.LF: is missing"),
        (
            ("model: point", "model: point, spine_shear_N: 4, spines_only: {LF: 1}"),
            r"contact\.spines_only: .*does not go with contact\.model point",
        ),
        (("feet:", "grasps:"), r"start\.grasps: does not go with contact\.model point; use feet"),
        (
            ("goal: {", "goal: {grasps: {LF: {hold: a, faces: x}}, "),
            r"goal\.grasps: .*does not go with contact\.model point",
        ),
        (
            ("goal: {", "planner: {objective: time}\ngoal: {"),
            r"planner\.objective: .*does not go with contact\.model point",
        ),
        (("LF: [0.1, 0.3]", "LF: [100, 300]"), r"start\.feet\.LF\[0\]: 100: .* looks like millimetres: 0\.1\?"),
    ],
)
def test_point_contacts_need_feet(change: tuple[str, str], says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        parse_scenario(POINT_TEXT.replace(*change))


def test_a_wall_may_be_long_but_nothing_may_stand_alone_far_away() -> None:
    far = [
        f"  - {{name: far-{i}, position_m: [{15 * i}, 0.8], size_m: [0.06, 0.06, 0.06], friction: 2}}"
        for i in (1, 2, 3)
    ]
    text = GOOD_TEXT.replace("holds:\n", "holds:\n" + "\n".join(far) + "\n")
    assert len(parse_scenario(text).holds) == len(parse_scenario(GOOD_TEXT).holds) + 3
    with pytest.raises(ScenarioError, match=r"holds\[2\]\.position_m\[0\]: 145: expected a number in .*\.\.50 m"):
        parse_scenario(text.replace("[45, 0.8]", "[145, 0.8]"))
