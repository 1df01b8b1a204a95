"""Expressions in C have the values of the equation language."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from dashred.physics.expressions.algebra import Call, Name
from dashred.physics.expressions.c_code import DEFINITIONS, c_code
from dashred.physics.expressions.functions import FUNCTIONS
from dashred.physics.expressions.parser import Vocabulary, parse

KNOWN = {"x": "x", "y": "y"}


def compiled(folder: Path, codes: list[str]) -> ctypes.CDLL:
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    bodies = [
        f"double f{i}(double x, double y) {{ return {code}; }}" for i, code in enumerate(codes)
    ]
    source = folder / "values.c"
    source.write_text("\n".join(["#include <math.h>", DEFINITIONS, *bodies]))
    library = folder / "values.so"
    subprocess.run([compiler, "-shared", "-fPIC", "-w", "-o", library, source, "-lm"], check=True)
    return ctypes.CDLL(str(library))


def values(folder: Path, codes: list[str], x: float, y: float = 0.0) -> list[float]:
    library = compiled(folder, codes)
    found = []
    for i in range(len(codes)):
        function = library[f"f{i}"]
        function.argtypes, function.restype = [ctypes.c_double] * 2, ctypes.c_double
        found.append(function(x, y))
    return found


def test_every_function_has_its_value(tmp_path: Path) -> None:
    codes = [c_code(Call(name, Name("x")), KNOWN) for name in FUNCTIONS]
    for number, x in enumerate((0.7, -0.7, 0.0)):
        (tmp_path / str(number)).mkdir()
        found = values(tmp_path / str(number), codes, x)
        for value, function in zip(found, FUNCTIONS.values(), strict=True):
            try:
                assert value == pytest.approx(function.scalar(x), abs=1e-15)
            except (ArithmeticError, ValueError):
                assert not math.isfinite(value)


def test_expressions_have_their_values(tmp_path: Path) -> None:
    x, y = -1.3, 0.6
    texts = {
        "-0.25*x*abs(x) + y**3 - 1e-7": -0.25 * x * abs(x) + y**3 - 1e-7,
        "where(x > 0, sqrt(x), 2*y/x)": 2 * y / x,
        "(x - y)**-2 + (y + 1)**0.5": (x - y) ** -2 + (y + 1) ** 0.5,
    }
    vocabulary = Vocabulary(frozenset(KNOWN))
    codes = [c_code(parse(text, vocabulary, where="here"), KNOWN) for text in texts]
    found = values(tmp_path, codes, x, y)
    np.testing.assert_allclose(found, list(texts.values()), rtol=1e-15)


def test_a_derivative_in_space_is_refused() -> None:
    expr = parse("d(x, s)", Vocabulary(frozenset(KNOWN), ("s",)), where="here")
    with pytest.raises(TypeError, match="not pointwise"):
        c_code(expr, KNOWN)
