"""Build the FMU of ``oscillator.c``; a test is skipped where that is not possible."""

from __future__ import annotations

import inspect
import re
import shutil
import subprocess
from pathlib import Path
from zipfile import ZipFile

import pytest

from dashred.physics.external.adapters.fmu.description import DIRECTIONAL

SOURCE = Path(__file__).with_name("oscillator.c")
VARIABLES = {
    "x": ("output", "continuous", "exact", 1, ""),
    "der(x)": ("local", "continuous", "calculated", None, "x"),
    "body.v": ("output", "continuous", "exact", 0, ""),
    "der(body.v)": ("local", "continuous", "calculated", None, "body.v"),
    "k": ("parameter", "fixed", "exact", 4, ""),
    "c": ("parameter", "fixed", "exact", 0.1, ""),
    "f": ("input", "continuous", "", 0, ""),
    "n": ("parameter", "fixed", "exact", 0, ""),
}


def build(
    folder: Path,
    version: int,
    kinds: str = "ModelExchange CoSimulation",
    events: int = 0,
    platform: str = "",
    bent: int = 0,
    derivatives: float | None = None,
    offers: bool = False,
) -> Path:
    """Return the path of an FMU of ``FMI version`` with these kinds.

    Args:
        folder: of the FMU.
        version: 2 or 3.
        kinds: that it offers.
        events: number of its event indicators, 0 or 1.
        platform: of its library; empty for this one.
        bent: 1 for van der Pol's oscillator.
        derivatives: factor of its directional derivatives; None if it has none.
        offers: whether it says that it has them.
    """
    fmpy = pytest.importorskip("fmpy")
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    library = folder / "oscillator.so"
    code = f"#define FMI {version}\n#define EVENTS {events}\n#define BENT {bent}\n"
    if derivatives is not None:
        code += f"#define DERIVATIVES {derivatives}\n"
    code += f"{SOURCE.read_text()}\n"
    # FMPy loads all functions of the standard, though it calls few.
    for name in _functions(version):
        is_absent = derivatives is None and name.endswith("DirectionalDerivative")
        if is_absent or not re.search(rf"\b{name}\(", code):
            code += f"int {name}(void) {{ return 3; }}\n"
    (folder / "all.c").write_text(code)
    words = [compiler, "-shared", "-fPIC", "-w", "-o", str(library), str(folder / "all.c")]
    subprocess.run(words, check=True)
    path = folder / f"oscillator{version}.fmu"
    native = fmpy.platform if version == 2 else fmpy.platform_tuple
    with ZipFile(path, "w") as archive:
        archive.write(library, f"binaries/{platform or native}/oscillator{library.suffix}")
        archive.writestr(
            "modelDescription.xml", description(version, kinds.split(), events, offers)
        )
    return path


def _functions(version: int) -> list[str]:
    from fmpy import fmi2, fmi3

    classes = {2: (fmi2.FMU2Model, fmi2.FMU2Slave), 3: (fmi3.FMU3Model, fmi3.FMU3Slave)}[version]
    members = (name for each in classes for name, _ in inspect.getmembers(each))
    return sorted({name for name in members if name.startswith(f"fmi{version}")})


def description(version: int, kinds: list[str], events: int, offers: bool) -> str:
    """Return the description of the model."""
    numbers = {name: index for index, name in enumerate(VARIABLES, start=1)}
    lines = []
    for name, (causality, variability, initial, start, state) in VARIABLES.items():
        reals, integers = ("Real", "Integer") if version == 2 else ("Float64", "Int32")
        kind = integers if name == "n" else reals
        own = f'name="{name}" valueReference="{numbers[name]}" causality="{causality}"'
        own += f' variability="{variability}"' + (f' initial="{initial}"' if initial else "")
        more = "" if start is None else f' start="{start}"'
        more += f' derivative="{numbers[state]}"' if state else ""
        if version == 2:
            lines.append(f"<ScalarVariable {own}><{kind}{more}/></ScalarVariable>")
        else:
            lines.append(f"<{kind} {own}{more}/>")
    states = [numbers[name] for name in VARIABLES if name.startswith("der(")]
    if version == 2:
        root = f'fmiVersion="2.0" guid="{{1}}" numberOfEventIndicators="{events}"'
        structure = "".join(f'<Unknown index="{i}"/>' for i in states)
        structure = f"<Derivatives>{structure}</Derivatives>"
    else:
        root = 'fmiVersion="3.0" instantiationToken="{1}"'
        structure = "".join(f'<ContinuousStateDerivative valueReference="{i}"/>' for i in states)
        structure += '<EventIndicator valueReference="1"/>' * events
    own = f'{DIRECTIONAL}{"" if version == 2 else "s"}="true"' if offers else ""
    interfaces = "".join(f'<{kind} modelIdentifier="oscillator" {own}/>' for kind in kinds)
    return (
        f'<?xml version="1.0"?><fmiModelDescription {root} modelName="oscillator">{interfaces}'
        f"<ModelVariables>{''.join(lines)}</ModelVariables>"
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )
