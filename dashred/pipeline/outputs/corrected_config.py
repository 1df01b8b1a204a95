"""Write `corrected.yaml`: the configuration of the user with the law added."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import asdict
from pathlib import Path
from statistics import fmean
from textwrap import wrap
from typing import Any

import yaml

from dashred.config import Config
from dashred.config.layers import written_out
from dashred.core.files.atomic import write_text_atomic
from dashred.core.findings.hidden_state_schema import HiddenStateFound
from dashred.core.formatting import PLUS_MINUS, sentence
from dashred.data.stated.fitted_delays import delay_parameter
from dashred.inference.fit.law import Law
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.inference.results.explanation import terms_of_law
from dashred.inference.results.fitted_parameters import fitted_parameters
from dashred.inference.results.hidden_state import hidden_state
from dashred.physics.boundaries.entries import offset_meanings
from dashred.physics.expressions.algebra import names
from dashred.physics.hidden_state import HiddenState, without_hidden_state
from dashred.physics.system import System
from dashred.reporting.text.fitted_parameters import TITLE, fitted_parameter_text
from dashred.reporting.text.hidden_state import hidden_state_text
from dashred.reporting.wording.findings_text import law_text

NAME = "corrected.yaml"
# Keys that belong to one run or to one recording. The corrected system does not depend on them.
RUN_KEYS = ("output", "tracking")
RECORDING_KEYS = (
    "twin",
    "path",
    "sensors",
    "noise",
    "std",
    "duration",
    "ignore",
    "reads",
    "average",
    "calibration",
)
# Paths of a program, which were relative to the user's file.
PROGRAM_PATHS = {"fmu", "template", "command"}
WIDTH = 96
NO_TERM = "With the fitted parameters, the recording shows no missing term."


def write_corrected(
    path: Path,
    config: Config,
    system: System,
    law: Law,
    recording_sha256: str,
    remark: str = "",
    hidden: HiddenState | None = None,
    dt: float | None = None,
) -> None:
    """Write the configuration of the corrected simulator atomically.

    It contains the keys of the user's file and command line, with the equations, lets and
    parameters of :func:`dashred.inference.results.corrected_system.build_corrected_system`.
    Uncertain parameters have their fitted values, without a spread. The defaults stay in
    ``conf/base.yaml``. It contains no paths but those of a program and its nodes, which are
    absolute, so it runs in any folder. The remark is part of its header. A hidden state of the
    law is one more field, and begins at its fitted start.

    Args:
        path: of the file.
        config: the user's configuration.
        system: the simulator.
        law: the law.
        recording_sha256: hash of the recording.
        remark: a sentence for the header.
        hidden: a hidden state that was added to the system.
        dt: a time step with which the corrected simulator is stable; None if that of the simulator
            is.
    """
    values = _user_values(config)
    found = hidden_state(system, law, hidden)
    corrected = build_corrected_system(system, law)
    if hidden is not None and found is None:
        corrected = corrected.with_config(without_hidden_state(corrected.config, hidden))
    if hidden is not None and found is not None:
        for key, value in _sections_of(corrected, hidden, found).items():
            _put(values, ["system", key, hidden.name], value)
    equations = corrected.config.equations
    simulator = config.system.simulator
    if simulator is not None:
        # What is not stated is added to no field of a program.
        equations = {name: text for name, text in equations.items() if text != "0"}
        if config.system.nodes is not None:
            values["system"]["nodes"] = config.system.nodes
        for key in PROGRAM_PATHS & values["system"]["simulator"].keys():
            values["system"]["simulator"][key] = getattr(simulator, key)
    values["system"]["equations"] = _Block(equations)
    # Lets and parameters that were added for the sensors belong to the recording.
    stated = config.system
    if lets := {n: text for n, text in corrected.config.let.items() if n in stated.let}:
        values["system"]["let"] = _Block(lets)
    if dt is not None or config.system.integrator.dt is None:
        # A chosen step was chosen from the recording, which this file does not name.
        _put(values, ["system", "integrator", "dt"], dt or system.dt)
    # The equations replace the Python class of the simulator.
    values["system"].pop("class", None)
    # Uncertain parameters have their fitted values.
    values["system"].pop("parameter_spread", None)
    values["system"].pop("parameter_per", None)
    for name, given in stated.inputs.items():
        if given.delay_spread:
            delay = max(corrected.config.parameters[delay_parameter(name)], 0.0)
            section = values["system"]["inputs"][name]
            section.pop("delay_spread")
            section["delay"] = float(f"{delay:.12g}")
    # The structure was declared for the uncorrected equations and would be refused with others.
    if _loses_structure(config, corrected):
        values["system"].pop("structure", None)
    offsets = offset_meanings(corrected.config, corrected.where)
    known = corrected.config.parameters
    written = [
        *stated.parameters,
        *([hidden.constant] if hidden and found else []),
        *(name for name in offsets if known[name] and name not in stated.parameters),
    ]
    if written:
        # This writes 0.035 + 0.01 as 0.045 and not as 0.045000000000000005.
        rounded = {name: float(f"{_value(corrected, name):.12g}") for name in written}
        values["system"]["parameters"] = _Block(rounded)
    body = yaml.dump(values, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=WIDTH)
    header = _header(config, system, corrected, law, recording_sha256, remark, found)
    write_text_atomic(path, f"{header}\n{body}")


def _value(corrected: System, name: str) -> float:
    """Return the value of a parameter; the mean if it has one value per episode."""
    known = corrected.config.parameters
    if name in known:
        return known[name]
    return fmean(known[each] for each in names(corrected.lets[name]) & known.keys())


def _loses_structure(config: Config, corrected: System) -> bool:
    """Return whether the law invalidates the declared structure."""
    old, new = config.system, corrected.config
    lets = {name: text for name, text in new.let.items() if name in old.let}
    is_changed = dict(new.equations) != dict(old.equations) or lets != dict(old.let)
    return old.structure is not None and is_changed


def _user_values(config: Config) -> dict[str, Any]:
    """Return the values of the user's file with the overrides of the command line."""
    values = written_out(deepcopy(config.written))
    checked = asdict(config)
    checked["system"]["class"] = checked["system"].pop("class_")
    for key in RUN_KEYS:
        values.pop(key, None)
    recording = values.get("recording", {})
    for key in RECORDING_KEYS:
        recording.pop(key, None)
    for key, line in config.lines.items():
        if key and line == config.override_place and "[" not in key:
            parts = key.split(".")
            if parts[0] not in RUN_KEYS and not _belongs_to_recording(parts):
                _put(values, parts, _get(checked, parts))
    if not values.get("recording", {}):
        values.pop("recording", None)
    # By default the experiment would have the name of the file, "corrected".
    values["tracking"] = {"experiment": config.tracking.experiment or config.name}
    return values


def _belongs_to_recording(parts: list[str]) -> bool:
    return parts[0] == "recording" and (len(parts) < 2 or parts[1] in RECORDING_KEYS)


def _sections_of(
    corrected: System, hidden: HiddenState, found: HiddenStateFound
) -> dict[str, str | float]:
    """Return what the sections of a system state about a hidden state."""
    sections: dict[str, str | float] = {
        "fields": corrected.config.fields[hidden.name],
        "start": float(f"{found['start']:.6g}"),
        "spread": float(f"{hidden.spread:.3g}"),
    }
    if hidden.name in corrected.units:
        sections["units"] = corrected.units[hidden.name]
    return sections


def _header(
    config: Config,
    system: System,
    corrected: System,
    law: Law,
    recording_sha256: str,
    remark: str,
    hidden: HiddenStateFound | None,
) -> str:
    origin = "given as a dict" if config.source is None else config.source.name
    lines = [
        f"{system.title}, corrected: the simulation with the law that dashred found.",
        "",
        *_law_lines(config, system, law),
        *([f"{sentence(hidden_state_text(hidden))}"] if hidden else []),
        *([remark] if remark else []),
        "",
        f"Found from the recording with sha256 {recording_sha256[:16]}…, seed {config.seed}; "
        f"{PLUS_MINUS}. The configuration was {origin}.",
        "",
        "The start and its spin-up are the configuration's own, so the spin-up now runs under the "
        "corrected equations; the start that was fitted to the recording is in estimates.nc."
        + (f" {hidden['state']} begins at its fitted start." if hidden else ""),
        "",
        *_structure_note(config, corrected),
        "dashred train conf=OUTPUT/corrected.yaml recording.path=RECORDING",
    ]
    if isinstance(config.recording.sensors, str):
        lines[-1] += " recording.sensors=TABLE"
    wrapped = [part for line in lines for part in wrap(line, WIDTH - 2) or [""]]
    return "\n".join(f"# {line}".rstrip() for line in wrapped)


def _law_lines(config: Config, system: System, law: Law) -> list[str]:
    """Return the law in words, and the fitted parameters, one a line."""
    terms, stated = terms_of_law(system, law), config.system.parameter_spread
    fitted = [each for each in fitted_parameters(system, law) if each["parameter"] in stated]
    if not fitted:
        return [law_text(terms, system)]
    listed = [f" {fitted_parameter_text(each)}" for each in fitted]
    return [law_text(terms, system) if terms else NO_TERM, "", f"{TITLE}:", *listed]


def _structure_note(config: Config, corrected: System) -> list[str]:
    if not _loses_structure(config, corrected):
        return []
    note = (
        "The structure is left out, because it was declared for the equations without the law. "
        "findings.json lists what the law changes in it, and whether it remains port-Hamiltonian."
    )
    return [note, ""]


def _get(values: Any, parts: list[str]) -> Any:
    for part in parts:
        values = values[part]
    return values


def _put(values: dict[str, Any], parts: list[str], value: Any) -> None:
    *sections, name = parts
    for section in sections:
        values = values.setdefault(section, {})
    values[name] = value


class _Block(dict[str, Any]):
    """Mapping that is written with one entry per line, because equations are long."""


class _Dumper(yaml.SafeDumper):
    """Dumper that writes short mappings in one line, as in the bundled configurations."""

    def __init__(self, *words: Any, **settings: Any) -> None:
        super().__init__(*words, **settings | {"default_flow_style": None})

    def ignore_aliases(self, data: Any) -> bool:
        """Write every value in full, because the reader does not accept aliases."""
        return True


_Dumper.add_representer(
    _Block,
    lambda dumper, block: dumper.represent_mapping(
        "tag:yaml.org,2002:map", block.items(), flow_style=False
    ),
)
