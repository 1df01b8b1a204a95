"""Conditions for each side: what is refused, with place and remedy."""

from __future__ import annotations

import pytest

from dashred.core.errors import InputError
from dashred.physics.expressions.algebra import to_text


def declared(make_system, ends, equation="d(u, x, 2)", axis="length: 1, points: 8"):
    return make_system(f"""
        axes: {{x: {{{axis}, ends: {ends}}}}}
        fields: {{u: heat, w: water}}
        parameters: {{k: 2.0}}
        equations: {{u: "{equation}", w: "d(k*d(w, x), x)"}}
        start: {{u: 0, w: 0}}
        integrator: {{dt: 0.1}}
    """)


@pytest.mark.parametrize(
    ("ends", "what", "hint"),
    [
        ("insulate", "must be periodic, insulated, fixed", "did you mean insulated?"),
        ("3", "or a section of sides; got 3", "for example"),
        ("{left: insulated}", "no condition for the right end", "add right"),
        ("{left: insulated, top: fixed}", "'top', which is not a side", "left, right"),
        ("{left: periodic, right: fixed}", "'periodic' is not a condition", "whole axis"),
        ("{left: insulatd, right: fixed}", "'insulatd' is not", "did you mean insulated?"),
        ("{left: {vlaue: 1}, right: fixed}", "neither a field nor", "did you mean value?"),
        ("{left: {u: {valu: 1}, w: fixed}, right: fixed}", "'valu'", "did you mean value?"),
        ("{left: {value: 1, slope: 0}, right: fixed}", "2 conditions at the left", "keep one"),
        ("{left: {u: {value: 1, flux: 0}, w: fixed}, right: fixed}", "2 conditions", "keep one"),
        ("{left: {u: fixed}, right: fixed}", "w has no condition at the left end", "add w"),
        ("{left: {u: fixed, value: 1}, right: fixed}", "both for all fields", "by its name"),
        ("{left: {T: fixed}, right: fixed}", "names 'T'", "u, w"),
        ("{left: {value: [1]}, right: fixed}", "must be a number or an expression", "example"),
        ("{left: [1], right: fixed}", "must be a word or a section", "insulated"),
        ("{left: {value: a*t}, right: fixed}", "'a'", None),
        ("{left: {value: u}, right: fixed}", "cannot depend on the field u", "use t"),
        ("{left: {value: x}, right: fixed}", "cannot depend on the coordinate x", "use t"),
    ],
)
def test_a_wrong_condition_is_refused_with_its_place(make_system, ends, what, hint):
    with pytest.raises(InputError) as caught:
        declared(make_system, ends)
    assert what in caught.value.what
    assert hint is None or hint in str(caught.value.hint)
    assert "declared.yaml" in str(caught.value.where)


@pytest.mark.parametrize(
    ("ends", "equation", "what"),
    [
        ("{left: {value: 1}, right: {value: 0}}", "-d(u, x)", "first derivatives only"),
        ("{left: {u: outflow, w: fixed}, right: {u: outflow, w: fixed}}", "-d(u, x)", "flows in"),
        ("{left: {value: 1}, right: fixed}", "-u", "no derivative along x"),
        ("{left: fixed, right: fixed}", "-d(u, x, 4)", "order 4"),
        ("{left: fixed, right: fixed}", "inv_lap(u)", "inv_lap is not available"),
        ("{left: {flux: 1}, right: fixed}", "d(u, x, 2) + d(u**2, x, 2)", None),
        ("{left: {flux: 1}, right: fixed}", "-d(u, x)", "no diffusive term"),
        ("{left: {flux: 1}, right: fixed}", "d(u*d(u, x), x)", "depends on a field"),
    ],
)
def test_conditions_fit_the_order_of_the_equation(make_system, ends, equation, what):
    if what is None:
        assert declared(make_system, ends, equation).has_conditions
        return
    with pytest.raises(InputError, match=what):
        declared(make_system, ends, equation)


def test_conditions_need_one_axis(make_system):
    with pytest.raises(InputError, match="systems with one axis"):
        make_system("""
            axes:
              x: {length: 1, points: 8, ends: {left: fixed, right: fixed}}
              y: {length: 1, points: 8}
            fields: {u: heat}
            equations: {u: lap(u)}
            start: {u: 0}
            integrator: {dt: 0.1}
        """)


def test_too_many_cells_are_refused(make_system):
    with pytest.raises(InputError, match="200 cells of 2 fields are too many"):
        declared(make_system, "{left: fixed, right: fixed}", axis="length: 1, points: 200")


def test_the_centre_of_a_radius_has_no_condition(make_system):
    with pytest.raises(InputError, match="centre of a radial axis"):
        declared(
            make_system,
            "{left: fixed, right: fixed}",
            axis="length: 1, points: 8, coordinates: radial",
        )


def test_a_flux_is_a_slope_and_has_an_offset(make_system):
    system = declared(make_system, "{left: {flux: 3*t}, right: insulated}")
    left = system.conditions["w"]["left"]
    assert left.kind == "slope"
    assert to_text(left.given) == "-(3*t + w_left_offset)/k" or "w_left_offset" in to_text(
        left.given
    )
    assert system.config.parameters["w_left_offset"] == 0.0
    assert system.with_config(system.config).config.parameters == system.config.parameters
