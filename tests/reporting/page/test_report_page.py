"""The plain words of a verdict, and the page: everything told, nothing referred to outside."""

import math
import re
from html.parser import HTMLParser
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest

from dashred.core.findings.cause_schema import Cause
from dashred.core.findings.fit_schema import Fit, errors_by_method
from dashred.core.findings.input_schema import Input
from dashred.core.findings.schema import new_findings
from dashred.pipeline.api.tables import terms_table
from dashred.reporting.page import html
from dashred.reporting.page.html import write_html
from dashred.reporting.text.headline import headline
from dashred.reporting.text.summary import summary
from dashred.reporting.text.verdict import verdict_lines

SYSTEM: dict[str, Any] = {
    "title": "Front <in> a ring & more",
    "axes": {"x": {"length": 6.28, "points": 64}},
    "equations": {"u": "-u*d(u, x) + nu*lap(u)", "lam": "1 - lam"},
}
SOURCE = Input(
    config={"system": SYSTEM},
    config_sha256="c0ffee",
    recording_sha256="facade",
    seed=7,
    versions={"torch": "2.13"},
    library_size={"u": 29},
    splits=None,
)
TERM: Any = {
    "equation": "u",
    "term": "u**3",
    "coefficient": -0.0251,
    "std": 0.0004,
    "ci95": [-0.0259, -0.0243],
    "inclusion": 0.98,
    "region": None,
    "effect": "cubic damping of internal energy (saturation)",
    "says": "cubic damping of internal energy (saturation), (−0.0251 ± 0.0004)·u³ per unit time",
}
CHANGE: Any = {
    "equation": None,
    "parameter": "nu",
    "term": "nu",
    "from": 0.035,
    "to": 0.05,
    "coefficient": 0.015,
    "std": 0.0004,
    "ci95": [0.0492, 0.0508],
    "aliases": [],
    "inclusion": 1.0,
    "region": None,
    "exact": True,
    "says": "nu is 0.0500 ± 0.0004, not 0.035",
}
WHERE: Any = {
    "equation": {"u": 0.97, "lam": 0.03},
    "region": None,
    "time": [0, 8],
    "regime": "u > 1.2 (39 % of space and time, 80 % of the effect)",
    "sensors": [],
    "significance": 1e-40,
    "profile": {"times": [], "before": [], "after": []},
    "forcing": None,
}
NEXT: Any = {
    "terms": [{"equation": "u", "term": "u**2", "coefficient": -0.03123, "region": None}],
    "delta_bic": 34.2,
    "rival": False,
    "same_as_best": False,
}


def found(**changed: Any) -> Any:
    fit = Fit(
        comparisons=[],
        noise_std=None,
        noise_correlation=None,
        own_error=None,
        chi2=1.02,
        unexplained=0.04,
        misfit_at_test_sensors=None,
        test_sensors=errors_by_method(
            simulation_same_start=0.61, simulation_refit=0.4, corrected=0.05, shred=0.3
        ),
        heldout_time=errors_by_method(simulation_refit=0.2, corrected=0.3),
        heldout_restarted=errors_by_method(simulation_refit=0.5, corrected=0.1),
    )
    given = {
        "fit": fit,
        "verdict": "missing-term",
        "causes": [{"kind": "missing-term", "probability": 0.93}],
        "where": WHERE,
        "terms": [TERM, CHANGE],
        "alternatives": [NEXT],
        "corrected": "corrected.yaml",
    }
    return new_findings(SOURCE, **given | changed)


def test_the_summary_begins_with_what_matters_most() -> None:
    lines = summary(found(), None, {}).splitlines()
    assert lines[:5] == [
        "Verdict: missing-term: terms are missing from the simulation.",
        f"  The simulation leaves out {TERM['says']}.",
        "  A parameter has a wrong value: nu is 0.0500 ± 0.0004, not 0.035.",
        "  The next best explanation, u: −0.0312·u², is worse by ΔBIC 34.",
        "  It acts in the equations of u (97 %) and lam (3 %), where u > 1.2 "
        "(39 % of space and time, 80 % of the effect).",
    ]
    assert lines[5] == (
        "  At the test sensors the error is 0.61 for the simulation from the same start, 0.4 for "
        "the simulation from its best start, 0.05 for the corrected simulation: 8 times smaller."
    )
    assert lines[6].endswith("0.3 for the corrected simulation: 1.5 times larger.")
    assert lines[7] == (
        "  In the held-out time, from a state fitted just before it, the error is 0.5 for the "
        "simulation from its best start, 0.1 for the corrected simulation: 5 times smaller."
    )
    assert lines[8:10] == ["", "± is the half-width of the 95 % interval."]
    assert lines[11].startswith("Front <in> a ring & more: the simulation compared with")


def test_the_energy_lost_is_told_cycle_by_cycle() -> None:
    energy = {
        "expression": "p**2",
        "cycles": 56,
        "first": {"lost": 0.04123, "std": 0.0012},
        "last": {"lost": -0.0021, "std": 0.0004},
    }
    text = "\n".join(verdict_lines(found(energy=energy)))
    assert (
        "The energy of the corrected system decreases by 4.1 ± 0.2 % in the first cycle "
        "and increases by 0.21 ± 0.08 % in the last of 56 cycles." in text
    )
    assert "The energy" not in "\n".join(verdict_lines(found()))


def test_of_many_terms_the_few_that_explain_nearly_all_are_told() -> None:
    terms = [TERM | {"term": name} for name in ("u", "u**2", "u**3", "u**4")]
    tried = {"equation": "u", "term": "u", "coefficient": -0.0312, "region": None}
    few = [
        {"terms": [tried], "explained": 0.9},
        {"terms": [tried, tried | {"term": "u**2"}], "explained": 0.9987},
        {"terms": [tried] * 3, "explained": 0.9999},
    ]
    text = "\n".join(verdict_lines(found(terms=terms, smaller=few)))
    assert "Of this, u: −0.0312·u, u: −0.0312·u² alone explains all but 0.13 %." in text
    # So many are told in symbols: nobody reads a paragraph of words.
    told = "leaves out 4 terms: u: −0.0251·u, u: −0.0251·u², u: −0.0251·u³, u: −0.0251·u⁴."
    assert told in text
    box = [{"axis": "x", "from": 10.1, "to": 16.0, "std": 0.1}]
    text = "\n".join(verdict_lines(found(terms=[*terms[:3], TERM | {"region": box}])))
    assert "u: −0.0251·u³ for 10.10 < x < 16.00 (± 0.20)." in text
    assert "cubic damping" in "\n".join(verdict_lines(found(terms=terms[:3])))
    assert "Of this" not in "\n".join(verdict_lines(found(terms=terms[:3], smaller=few)))
    assert "Of this" not in "\n".join(verdict_lines(found(terms=terms, smaller=few[:1])))


def test_an_ambiguous_verdict_names_the_rivals_and_calls_the_best_a_guess() -> None:
    rival = NEXT | {"rival": True, "delta_bic": 1.23}
    text = "\n".join(verdict_lines(found(verdict="ambiguous", alternatives=[rival])))
    assert "As the best guess, the simulation leaves out cubic damping" in text
    assert "Another law fits about as well: u: −0.0312·u² (ΔBIC 1.2)." in text
    assert "next best" not in text
    same = rival | {"same_as_best": True}
    text = "\n".join(verdict_lines(found(verdict="ambiguous", alternatives=[same])))
    assert "At these sensors, this law cannot be distinguished from: u: −0.0312·u²." in text
    assert "next best" not in text and "about as well:" not in text


def test_where_nothing_converged_only_the_reason_is_told() -> None:
    cause = {"kind": "not-converged", "probability": 1.0, "says": "the fit stopped half-way"}
    lost = found(verdict="not-converged", causes=[cause], where=None, terms=None, alternatives=None)
    text = "\n".join(verdict_lines(lost)[:3])
    assert "The fit stopped half-way." in text and "leaves out" not in text and "acts" not in text


def test_of_several_causes_the_leading_one_is_told_and_others_where_it_is_open() -> None:
    causes = [
        {"kind": "sensor-fault", "probability": 0.7, "says": "sensor s3 drifts"},
        {"kind": "initial-condition", "probability": 0.28, "says": "the start lies elsewhere"},
        {"kind": "missing-term", "probability": 0.02, "says": "something else"},
    ]
    sure, open_ = (
        "\n".join(verdict_lines(found(verdict=verdict, causes=causes)))
        for verdict in ("sensor-fault", "ambiguous")
    )
    assert "Sensor s3 drifts." in sure and "elsewhere" not in sure
    assert "Sensor s3 drifts." in open_ and "The start lies elsewhere." in open_
    assert "something else" not in open_.lower()


def test_without_a_verdict_there_are_no_words() -> None:
    assert verdict_lines(new_findings(SOURCE)) == []


class Page(HTMLParser):
    """What a browser would make of the page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.words: list[str] = []
        self.sources: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Remember what is open, and what is referred to."""
        if tag not in ("meta", "img"):
            self.open.append(tag)
        self.sources += [value or "" for name, value in attrs if name in ("src", "href")]

    def handle_endtag(self, tag: str) -> None:
        """Close what was opened last."""
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        """Keep what a reader sees."""
        if not {"style", "script"} & set(self.open):
            self.words.append(" ".join(data.split()))


def text_of(findings: Any, figures: Any = MappingProxyType({}), commit: str | None = None) -> str:
    """The page's text as a reader sees it, on one line."""
    return " ".join(Page(html.page(findings, figures, "", commit=commit)).words)


@pytest.fixture
def page(tmp_path: Path) -> Page:
    image = tmp_path / "where.png"
    image.write_bytes(b"\x89PNG")
    figures = {"where": {"Where <it> acts": image}}
    write_html(tmp_path / "report.html", found(), figures, "printed <text>")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["report.html", "where.png"]
    return Page((tmp_path / "report.html").read_text(encoding="utf-8"))


def test_the_page_refers_to_nothing_outside_itself(page: Page, tmp_path: Path) -> None:
    assert page.sources == ["data:image/png;base64,iVBORw=="] and not page.open
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"https?://|@import|url\(|<script", text)
    assert str(tmp_path) not in text


def test_nothing_in_findings_becomes_markup(tmp_path: Path) -> None:
    evil = "<script>alert('1')</script>\" onload=\"x"
    image = tmp_path / "a.png"
    image.write_bytes(b"\x89PNG")
    system = SYSTEM | {"title": evil, "equations": {"u": evil}, "let": {evil: evil}}
    system |= {"inputs": {evil: evil}, "snapshots": evil}
    config = {"system": system, "recording": {"path": evil, "sensors": evil}}
    splits: Any = {"inputs": [evil], "extra": [], "validate": [], "test": [evil], "note": evil}
    splits |= {"time_end": 1.0}
    source: Any = SOURCE | {"config": config, "splits": splits, "library_size": {evil: 1}}
    cause = {"kind": "outside-library", "probability": 1.0, "says": evil}
    other = NEXT | {"terms": [NEXT["terms"][0] | {"term": evil}]}
    findings = found(terms=[TERM | {"term": evil, "says": evil}], causes=[cause])
    findings |= {"alternatives": [other], "units": {evil: evil}, "corrected": evil}
    fitted = {"parameter": evil, "stated": 1, "spread": 2, "value": 1, "std": 2, "ci95": [0, 1]}
    findings["fitted_parameters"] = [fitted | {"aliases": [evil], "exact": False, "unit": evil}]
    findings["fit"]["noise_std"] = {evil: 0.1}
    figures = {place: {evil: image} for place in ("where", "what", "proof", "forecast", "method")}
    text = html.page(findings | {"input": source}, figures, evil, [evil], evil)
    assert "<script" not in text and 'onload="' not in text
    # More often than there are fields that hold it: every one of them is on the page.
    assert text.count("&lt;script&gt;") > 20
    assert not Page(text).open


def test_the_page_tells_the_law_its_rivals_the_proof_and_where_it_comes_from(page: Page) -> None:
    words = page.words
    assert "Front <in> a ring & more: the simulation compared with the recording" in words
    first = words.index("Verdict: missing-term: terms are missing from the simulation.")
    titles = [
        "Where",
        "What",
        "Confidence",
        "Errors before and after the correction, on held-out data",
    ]
    titles += ["Unexplained misfit", "Method", "Provenance", "The printed summary"]
    places = [first, *map(words.index, titles)]
    assert places == sorted(places)
    for told in ("u³", "−0.0251", "−0.0259 … −0.0243", "98 %", "0.035 → 0.0500"):
        assert told in words, told
    for told in (
        "u: −0.0312·u²",
        "34.2",
        "0.61",
        "Where <it> acts",
        "c0ffee",
        "facade",
        "29 terms for u",
        "Probabilities of the causes: a missing term 93 %, none of these 7 %.",
    ):
        assert told in words, told
    assert "printed <text>" in words and "None" not in " ".join(words)


def test_the_equations_show_what_is_put_into_them() -> None:
    lines = html.page(found(), {}, "")
    assert "∂u/∂t = −u·d(u, x) + nu·lap(u) <mark>− 0.0251·u³</mark>" in lines
    assert "∂&thinsp;lam/∂t = 1 − lam</div>" in lines
    assert "<mark>nu = 0.0500</mark> instead of 0.035" in lines
    gate = [{"field": "u", "above": 0.4, "std": 0.01, "ci95": [0.38, 0.42]}]
    added = TERM | {"term": "u - u**2", "coefficient": 0.2, "region": gate}
    known = found(terms=[added, CHANGE], units={"u": "J", "nu": "m2 s-1"})
    assert "<mark>+ 0.2000·(u − u²) for u &gt; 0.400 J (± 0.020)</mark>" in html.page(known, {}, "")
    assert "<mark>nu = 0.0500 m²/s</mark>" in html.page(known, {}, "")
    assert html.page(found(terms=[]), {}, "").count("<mark>") == 0


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (
            {},
            "The simulation leaves out cubic damping of internal energy (saturation), and it has a "
            "wrong parameter: nu is 0.0500, not 0.035. With this correction, the error at sensors "
            "not used in any fit is 8 times smaller.",
        ),
        (
            {"terms": [TERM | {"effect": "a further change of u"}]},
            "The simulation leaves out a further change of u. With",
        ),
        (
            {"terms": [TERM | {"term": t, "effect": "a further change of u"} for t in "st"]},
            "The simulation leaves out a further change of u. With",
        ),
        (
            {"terms": [TERM | {"effect": "forward transport of u in x"}]},
            "The simulation leaves out forward transport of u in x. With",
        ),
        (
            {"verdict": "parameter", "terms": [CHANGE]},
            "The simulation has a wrong parameter: nu is 0.0500, not 0.035. With",
        ),
        (
            {
                "verdict": "parameter",
                "terms": [CHANGE | {"parameter": name} for name in ("nu", "k")],
            },
            "The simulation has wrong parameters: nu is 0.0500, not 0.035 and k is 0.0500, not ",
        ),
        (
            {"terms": [TERM | {"term": t, "effect": f"effect {t}"} for t in "rst"]},
            "The simulation leaves out effect r, effect s and effect t. With",
        ),
        (
            {"verdict": "ambiguous", "terms": [TERM]},
            "Several explanations fit this recording about equally well; the best guess is cubic",
        ),
        ({"terms": [TERM] * 4}, "The simulation leaves out 4 effects at once. With"),
        (
            {
                "verdict": "outside-library",
                "terms": [TERM | {"effect": "a further change of u"}],
                "causes": [{"kind": "outside-library", "probability": 1.0, "terms": ["u: sin(u)"]}],
            },
            "The simulation leaves out a further change of u, in a form that is not in its "
            "library. With",
        ),
        ({"verdict": "nothing-missing", "terms": []}, "The simulation agrees with the recording"),
    ],
)
def test_the_headline_is_one_plain_sentence(changed: dict[str, Any], told: str) -> None:
    assert headline(found(**changed)).startswith(told)


def test_of_many_terms_the_headline_names_the_few_that_say_nearly_all() -> None:
    many = found(verdict="outside-library", terms=[TERM] * 5)
    told = headline(many, ["viscous damping of angular velocity"])
    assert "the nearest is mostly viscous damping of angular velocity (5 terms in all)." in told


def test_causes_are_told_with_their_probabilities(tmp_path: Path) -> None:
    weighed = [("outside-library", 0.93), ("missing-term", 0.9), ("parameter", 1e-5)]
    causes = [{"kind": kind, "probability": p} for kind, p in weighed]
    write_html(tmp_path / "report.html", found(causes=causes), {}, "")
    page = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    told = "an effect outside the library 93 %, a missing term 90 %, others less than 1 %, none of "
    assert any(told in line for line in page.words)


NEAREST = [
    {"kind": "outside-library", "probability": None, "gain": 9.0},
    {"kind": "parameter", "probability": 0.93},
]


@pytest.mark.parametrize(
    "changed",
    [
        {"verdict": "unconfirmed"},
        {"verdict": "outside-library", "causes": NEAREST},
        {"verdict": "outside-library", "causes": NEAREST, "terms": []},
    ],
)
def test_probabilities_that_are_not_confirmed_are_not_told(changed: dict[str, Any]) -> None:
    told = found(**changed)
    assert "93 %" not in text_of(told) and "robabilit" not in text_of(told)
    assert terms_table(told)["inclusion"].isna().all()
    sure = found(verdict="missing-term")
    assert "93 %" in text_of(sure) and list(terms_table(sure)["inclusion"]) == [0.98, 1.0]


def test_a_law_that_is_nowhere_better_has_no_probability() -> None:
    worse = found()
    errors = errors_by_method(simulation_refit=0.2, corrected=0.4)
    worse["fit"] |= {"test_sensors": errors, "heldout_time": errors, "heldout_restarted": errors}
    assert "robabilit" not in text_of(worse)


def test_the_noise_of_the_traces_is_told_apart_from_the_residuals() -> None:
    told = found()
    told["fit"] |= {"noise_std": {"s1": 0.1}, "residual_std": {"s1": 3.6}}
    assert "stated or estimated from their traces, std s1 0.1 residuals of the fit, std s1 3.6" in (
        text_of(told).replace("  ", " ")
    )


@pytest.mark.parametrize(
    ("share", "told"),
    [(0.01, "are no larger than"), (0.75, "are 2 times as large")],
)
def test_what_stays_unexplained_is_held_against_the_noise(share: float, told: str) -> None:
    left = found()
    left["fit"]["unexplained"] = share
    assert told in text_of(left)


def test_the_headline_does_not_claim_a_gain_that_there_is_none_of() -> None:
    worse = found()
    worse["fit"]["test_sensors"] = errors_by_method(simulation_refit=0.2, corrected=0.4)
    assert "is 2 times larger." in headline(worse)
    worse["fit"]["test_sensors"] = errors_by_method()
    worse["fit"]["heldout_episode"] = errors_by_method(simulation_refit=0.4, corrected=0.1)
    assert "in an episode not used in any fit is 4 times smaller." in headline(worse)
    worse["fit"]["test_sensors"] = errors_by_method(simulation_refit=0.2, corrected=0.199)
    assert "is unchanged." in headline(worse)
    worse["fit"]["test_sensors"] = errors_by_method(simulation_refit=0.2, corrected=math.inf)
    assert "the simulation diverges at sensors not used in any fit." in headline(worse)
    assert "correction" not in headline(found(verdict="nothing-missing", terms=[]))


def test_units_stand_with_the_numbers_of_the_page(tmp_path: Path) -> None:
    box = [{"axis": "x", "from": 10.1, "to": 16.0, "std": 0.1}]
    known = found(
        terms=[TERM | {"unit": "1/(J^2 s)"}],
        where=WHERE | {"region": box, "regime": None},
        units={"x": "m", "t": "s"},
    )
    write_html(tmp_path / "report.html", known, {}, "")
    words = Page((tmp_path / "report.html").read_text(encoding="utf-8")).words
    assert "unit" in words and "1/(J²·s)" in words and "x in m, t in s" in words
    assert any("for 10.10 < x < 16.00 m (± 0.20)" in line for line in words)


def test_a_page_of_findings_that_found_nothing_is_short_but_whole(tmp_path: Path) -> None:
    write_html(tmp_path / "report.html", new_findings(SOURCE), {}, "")
    page = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert not page.open and "What" not in page.words and "Provenance" in page.words


def test_a_forecast_says_what_becomes_of_inputs(tmp_path: Path) -> None:
    image = tmp_path / "forecast.png"
    image.write_bytes(b"\x89PNG")
    figures = {"forecast": {"The forecast": image}}
    assert "runs beyond the end" not in text_of(found())
    assert "runs beyond the end" in text_of(found(), figures)
    assert "keep their last value" not in text_of(found(), figures)
    driven = {**SYSTEM, "inputs": {"e": "voltage", "f": "force"}}
    source = {**SOURCE, "config": {"system": driven}}
    told = text_of({**found(), "input": source}, figures)
    assert "Inputs (e, f) keep their last value where they were not measured." in told


def test_the_page_of_an_unresolved_simulator_claims_no_fit(tmp_path: Path) -> None:
    splits: Any = {"inputs": ["p0"], "extra": [], "validate": ["p1"], "test": ["p2"]}
    splits |= {"time_end": 3.2, "note": "Sensors at random."}
    says = "doubling the resolution moves a sensor trace by 5.0%; 48 points would do"
    cause: Cause = {"kind": "unresolved-numerics", "says": says, "probability": 1.0}
    unresolved = new_findings(
        SOURCE | {"splits": splits}, verdict="unresolved-numerics", causes=[cause]
    )
    write_html(tmp_path / "report.html", unresolved, {}, "")
    text = "\n".join(Page((tmp_path / "report.html").read_text(encoding="utf-8")).words)
    assert "numerical error of the simulation is too large" in text and says[1:] in text
    assert "nothing was trained or fitted" in text and "Sensors at random." in text
    assert "Every law was fitted" not in text and "were read once" not in text


def test_provenance_names_files_and_commit_and_takes_no_value_for_a_files_hash() -> None:
    config = {"system": SYSTEM | {"snapshots": "runs.nc"}}
    config |= {"recording": {"path": "mine.csv", "sensors": "table.csv"}}
    source: Any = SOURCE | {"config": config, "snapshots_sha256": "5eed"}
    rows = Page(html.page(found() | {"input": source}, {}, "", commit="ab12+")).words
    for what, value in {
        "recording": "mine.csv",
        "table of sensors": "table.csv",
        "snapshots": "runs.nc",
        "recording's values, sha256": "facade",
        "snapshots' values, sha256": "5eed",
        "dashred, git commit": "ab12+",
    }.items():
        assert rows.count(what) == 1 and rows[rows.index(what) + 1] == value
    assert any("not of the files" in row for row in rows)
    assert "dashred, git commit" not in text_of(found())


def test_the_same_findings_give_the_same_page(tmp_path: Path) -> None:
    for name in ("a.html", "b.html"):
        write_html(tmp_path / name, found(), {}, "")
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


def test_the_part_of_the_structure_that_changes_is_told() -> None:
    def told(passive: bool, kept: bool) -> str:
        changes = [{"term": "p: p", "part": "R", "passive": passive}]
        structure = {"changes": changes, "port_hamiltonian": kept}
        return "\n".join(verdict_lines(found(structure=structure)))

    assert "p: p changes R, the dissipation. The corrected system remains" in told(True, True)
    assert "R, and reduces the dissipation. The corrected system remains" in told(False, True)
    assert "R, and adds energy. The corrected system is not" in told(False, False)
    assert "port-Hamiltonian" not in "\n".join(verdict_lines(found()))


def test_every_episode_stands_on_the_page(tmp_path: Path) -> None:
    splits: Any = {"inputs": ["p0"], "extra": [], "validate": [], "test": [], "note": None}
    kept = {"name": "b", "begin": 20.0, "end": 30.0, "time_end": 21.0, "held_out_whole": True}
    fitted = {"name": "a", "begin": 0.0, "end": 10.0, "time_end": 8.0, "held_out_whole": False}
    splits |= {"time_end": 8.0, "episodes": [fitted, kept]}
    told = found() | {"input": SOURCE | {"splits": splits}, "units": {"t": "s"}}
    write_html(tmp_path / "report.html", told, {}, "")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "a, from 0 to 10 s: fitted until 8" in text
    assert "b, from 20 to 30 s: held out; its first part, to 21, determines its start" in text
