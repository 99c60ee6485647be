"""The page of weighing: one line for each name and set, pictures of what has one, and the file within reach."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from probability_samples import RUN, answer

from schwung.drivetrain import paper_machine
from schwung.drivetrain.residual_plane import Plane
from schwung.explain.publishing.values import Curve, Name, merged
from schwung.explain.values import Located, Quantity
from schwung.explain.weighing.values import Lasting, Parameter, Timing
from schwung.explain.words import told_apart_by
from schwung.report.content import units_of
from schwung.report.explanation import (
    ExplanationContent,
    fact_rows,
    name_rows,
    render_explanation,
    separations,
    set_rows,
    tables,
)

X, Y = np.linspace(0, 3, 31), np.linspace(-40, 40, 21)
PLANE = Curve(
    "position, speed", "rad, rad/s", 0.8, 0.9, "", True,
    plane=Plane(("position", "speed"), X, Y, np.sin(2 * X)[:, None] * Y / 20),
)  # fmt: skip
BENDS = Name(
    "presliding_friction", 0.9,
    {"torque_nm": Quantity(1.2, "N·m", (1.1, 1.3)), "stiffness_nm_rad": Quantity(2.4, "N·m/rad", (2.2, 2.6))}, True,
)  # fmt: skip


def shown(published):
    return render_explanation(ExplanationContent("A title", published, paper_machine(), None, 'name = "x"'))


class Titles(HTMLParser):
    """The headings of a page, in their order."""

    def __init__(self, text):
        super().__init__()
        self.found, self.inside = [], False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.inside = tag == "h2"

    def handle_data(self, data):
        if self.inside:
            self.found.append(data)
        self.inside = False


def test_sets_of_one_name_and_other_shapes_are_one_line():
    told = merged(
        [(("cogging", "backlash"), 0.3), (("coulomb_friction",), 0.35), (("backlash", "cogging"), 0.3)]
    )
    assert told == ((("backlash", "cogging"), pytest.approx(0.6)), (("coulomb_friction",), 0.35))
    assert merged([((), 0.995), (("cogging",), 0.004)]) == (((), 0.995),)
    assert merged([((f"name {i}",), 0.1) for i in range(10)])[-1][1] == 0.1
    assert len(merged([((f"name {i}",), 0.1) for i in range(10)])) == 6


def test_the_set_of_the_file_is_marked():
    rows = set_rows(answer())
    assert [row[2] for row in rows] == ["this", ""]
    assert rows[1][0] == "play in the coupling"


def test_one_set_alone_is_no_table():
    assert set_rows(replace(answer(), runners_up=((("speed", "torque_offset"), 1.0),))) == []


def test_pictures_stand_behind_what_was_found_and_before_the_rest():
    text = shown(replace(answer(), names=(*answer().names, BENDS), curves=(*answer().curves, PLANE)))
    titles = Titles(text).found
    assert titles[:3] == ["Names", "Modelled, unnamed", "Probabilities"]
    assert titles[-1] == "The learned machine"
    assert titles.index("Without a name, over position and speed") < titles.index("Sets of causes")
    assert "Friction that is a spring before it slides" in titles
    assert text.count("<svg") == 9
    assert "−40" in text or "-40" in text


def test_a_speed_that_is_missed_is_drawn_where_that_is_what_is_missed():
    late = Located("acceleration", (-400.0, 400.0), "rad/s²", 1.0, 1e-9, "All of it.", "speed")
    missed = replace(RUN, speed_before_rad_s=4e-4 * RUN.acceleration_rad_s2, speed_after_rad_s=0 * RUN.time_s)
    of_speed = replace(answer(), mismatch=(late,), overlays=(missed,))
    assert "The reported speed" in Titles(shown(of_speed)).found
    for other in (replace(answer(), overlays=(missed,)), replace(of_speed, overlays=(RUN,))):
        assert "The reported speed" not in Titles(shown(other)).found


def test_what_cannot_be_drawn_does_not_break_the_page():
    flat = replace(BENDS, parameters={**BENDS.parameters, "stiffness_nm_rad": Quantity(0.0, "N·m/rad", None)})
    assert "Friction that is a spring before it slides</h2>" not in shown(replace(answer(), names=(flat,)))


def test_it_says_where_and_what_would_tell_rivals_apart():
    of = answer()
    assert name_rows(of)[0][3] == "at −0.01 … 0.02 rad, while moving forward\n40 % of what the belief misses"
    rivals = replace(of, names=(Name("coulomb_friction", 0.6, {}, True),), curves=(),
                     runners_up=((("coulomb_friction",), 0.6), (("stribeck_friction",), 0.4)))  # fmt: skip
    ((question, motion),) = separations(rivals)
    assert "stribeck_friction" in question
    assert "several times slower" in motion
    told = {title: rows for title, _, rows in tables(rivals)}
    assert told["What the mismatch follows, in words"][0] == (
        "the belief",
        "Over the whole range of position, 70 %.",
    )
    document = of.to_json()
    assert document["names"][0]["where"]["direction"] == "forward"
    assert document["mismatch"][0]["coordinate"] == "position"
    assert document["proof"]["after_nm"] == 0.14


@pytest.mark.usefixtures("undrawn")
def test_without_anything_kept_aside_what_was_fitted_is_shown():
    run = replace(answer().overlays[0], heldout=False)
    text = shown(replace(answer(), proof=None, overlays=(run,)))
    assert "which was fitted" in text


def test_nothing_is_fetched_nothing_runs_and_text_stays_text():
    odd = replace(answer(), notes=("<script>alert(1)</script>",))
    page = render_explanation(ExplanationContent("A <press>", odd, paper_machine(), None, 'name = "a & b"'))
    assert "<script" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert "A &lt;press&gt;" in page
    assert "a &amp; b" in page
    assert not re.findall(r'(?:src|href)="(?!#)', page)
    assert "default-src 'none'" in page
    for svg in re.findall(r"<svg .*?</svg>", page, flags=re.DOTALL):
        ET.fromstring(svg.replace("xlink:href", "href"))
    ids = re.findall(r'\bid="([^"]*)"', page)
    assert len(ids) == len(set(ids)) > 0


def test_what_tells_two_apart_does_so_either_way():
    assert told_apart_by("stribeck_friction", "coulomb_friction") == told_apart_by(
        "coulomb_friction", "stribeck_friction"
    )


def test_repeats_that_differ_for_longer_than_noise_are_unexplained_where_nothing_was_found():
    found = replace(answer(), lasting=Lasting(0.05, 9.1))
    assert found.verdict == answer().verdict
    assert (
        "repeats of a motion differ, from run to run, by",
        "0.05 N·m, 9.1 times what is noise",
    ) in fact_rows(found, units_of("rotary", "torque"))
    assert found.proof is not None
    for proof in (replace(found.proof, before=1.0, after=1.0), None):
        bare = replace(found, names=(), curves=(), proof=proof)
        assert bare.verdict == "unexplained"
        assert bare.headline == (
            "unexplained: repeats of a motion differ by 0.05 N·m, 9.1 times what is noise, from one run to the next, "
            "and nothing was found that takes it"
        )
        assert not any(
            "left unexplained" in what for what, _ in fact_rows(bare, units_of("rotary", "torque"))
        )
        assert bare.to_json()["lasting"] == {"torque_nm": 0.05, "over_noise": 9.1}


def test_what_every_run_has_of_its_own_is_not_unexplained_where_no_file_foresees_it():
    """A payload that was laid on half of the runs was found in each, and "takes nothing" was said of it."""
    found = answer()
    assert found.proof is not None
    names = tuple(replace(one, each_run=one.in_file) for one in found.names)
    other = replace(found, names=names, proof=replace(found.proof, before=2.57, after=2.71))
    assert other.verdict == "partly_explained"
    assert other.headline.startswith("left out: ")
    assert "every run has its own of it, so that no file foresees run" in other.headline
    assert replace(other, names=found.names).verdict == "unexplained"


def test_what_runs_that_were_fitted_show_alone_is_no_all_clear():
    """Of a motor that clips in the fastest motion nothing shows on slower ones, which were kept aside."""
    found = replace(answer(), missed_runs=((1, 2.69), (6, 2.8)))
    assert answer().verdict == "explained"
    assert found.verdict == "partly_explained"
    told = ("plainly missed by machine.toml on runs that were fitted", "1 (2.69 σ), 6 (2.8 σ)")
    assert told in fact_rows(found, units_of("rotary", "torque"))
    assert found.proof is not None
    bare = replace(found, names=(), curves=(), proof=replace(found.proof, before=1.0, after=1.0))
    assert bare.verdict == "unexplained"
    assert bare.headline == (
        "unexplained: the belief misses up to 2.8 σ of the noise on runs 1, 6, and nothing was found that takes it"
    )
    assert bare.to_json()["missed_runs"] == [{"run": 1, "sigma": 2.69}, {"run": 6, "sigma": 2.8}]


@pytest.mark.parametrize(
    ("later_us", "than", "told"),
    [
        ((-87.0, -89.0, -85.0), "speed", ("speed", "torque", "87 µs (85 … 89), as is usual")),
        ((340.0, 338.0, 342.0), "speed", ("torque", "speed", "340 µs (338 … 342)")),
        ((2.0, -1.0, 5.0), "position", ("torque", "angle", "2 µs (−1 … 5), as is usual")),
    ],
)
def test_what_is_reported_later_is_told_as_so_much_later(later_us, than, told):
    later = Parameter(*(1e-6 * each for each in later_us))
    found = replace(answer(), timing=Timing(later, than, 7e-5))
    who, whom, size = told
    row = (f"the {who} is reported later than the {whom}, beyond the belief, by", size)
    assert row in fact_rows(found, units_of("rotary", "torque"))


def test_of_nothing_beyond_noise_no_share_is_told():
    found, units = answer(), units_of("rotary", "torque")
    assert found.proof is not None
    quiet = replace(found, names=(), curves=(), proof=replace(found.proof, before=1.0, after=1.0))
    assert quiet.verdict == "consistent"
    shares = [[what for what, _ in fact_rows(of, units) if "unexplained" in what] for of in (found, quiet)]
    assert [len(one) for one in shares] == [1, 0]


def test_where_names_share_what_the_file_holds_the_headline_tells_them():
    """Above a file that took fourteen times the noise it said that nothing was left out."""
    sides = (Name("coulomb_friction", 0.49, {}, False), Name("load_side_friction", 0.48, {}, False))
    like = Curve("direction", "", 0.1, 0.1, "load_side_friction", True)
    found = replace(answer(), names=sides, curves=(like,))
    assert found.verdict != "consistent"
    assert "one of dry friction (49 %), dry friction behind the coupling (48 %)" in found.headline
    assert "nothing" not in found.headline
