"""The last sections of the report: how it was done, and what determines the findings."""

from collections.abc import Mapping
from typing import Any

from dashred.core.formatting import number
from dashred.core.units import NONE, TIME, measured, shown
from dashred.reporting.page.parts import paragraphs, section, table
from dashred.reporting.text.improvement import UNTESTED


def how_it_was_done(findings: Mapping[str, Any], figures: str) -> str:
    """The data, who was held out, the library, and the method in a few sentences."""
    source, units = findings["input"], findings.get("units", NONE)
    lines = []
    if splits := source["splits"]:
        until = measured(number(splits["time_end"]), units.get(TIME))
        lines += _fitted(findings, until)
        if splits["note"]:
            lines.append(splits["note"])
    rows = _set_up(findings)
    return section("How it was done", paragraphs(lines), table([], rows) if rows else "", figures)


def _fitted(findings: Mapping[str, Any], until: str) -> list[str]:
    read = "Test sensors and held-out time were read once, when all of that was settled."
    if findings["verdict"] == "unresolved-numerics":
        return [
            "The simulation was run at its own resolution and at twice that. They differ by more "
            "at the sensors than may be, and the difference would have passed for missing "
            "physics: so nothing was trained or fitted, and what was held out was not looked at."
        ]
    if findings["verdict"] in UNTESTED:
        return [
            "SHRED was trained on the snapshots and assimilated to sensors alone, up to time "
            f"{until}. No law was fitted: there is no simulator to fit it through.",
            read,
        ]
    return [
        f"Every law was fitted through the simulator to sensors alone, up to time {until}: the "
        "start and the law together, every candidate term with every other, and the laws "
        "compared by what they explain for how many terms (BIC). Other causes were weighed by "
        "the same measure: a changed parameter, another start, a sensor at fault, a law that "
        "acts somewhere only, and something that no term of the library expresses.",
        read,
    ]


def provenance(findings: Mapping[str, Any], commit: str | None = None) -> str:
    """What determines the findings: the same again gives the same.

    Args:
        findings: of ``findings.json``.
        commit: of dashred's own checkout; None names none.
    """
    source = findings["input"]
    rows = [
        ["configuration, sha256", source["config_sha256"]],
        *_files(source["config"]),
        ["recording's values, sha256", source["recording_sha256"]],
        ["seed", str(source["seed"])],
        *([["dashred, git commit", commit]] if commit else []),
        ["versions", ", ".join(f"{name} {v}" for name, v in sorted(source["versions"].items()))],
    ]
    if "snapshots_sha256" in source:
        rows.append(["snapshots' values, sha256", source["snapshots_sha256"]])
    if findings["corrected"]:
        rows.append(["corrected simulation", findings["corrected"]])
    notes = [
        "The same configuration, recording, seed and versions give the same findings.json.",
        "Values are hashed as they were read, whatever file held them: sha256sum of a file "
        "is another number.",
    ]
    return section("Provenance", table([], rows), paragraphs(notes, "note"))


def _files(config: Mapping[str, Any]) -> list[list[str]]:
    """The names of the files that were read, where the findings know them."""
    recording = config.get("recording", {})
    named = {
        "recording": recording.get("path"),
        "table of sensors": recording.get("sensors"),
        "snapshots": config.get("system", {}).get("snapshots"),
    }
    return [[what, name] for what, name in named.items() if isinstance(name, str)]


def _set_up(findings: Mapping[str, Any]) -> list[list[str]]:
    source, fit, rows = findings["input"], findings["fit"], []
    if splits := source["splits"]:
        roles = {
            "inputs": "sensors that feed SHRED",
            "extra": "further fit sensors",
            "validate": "validation sensors",
            "test": "test sensors",
        }
        rows += [[role, ", ".join(splits[key])] for key, role in roles.items() if splits[key]]
        if episodes := splits.get("episodes"):
            unit = findings.get("units", NONE).get(TIME)
            rows.append(["episodes", "; ".join(_episode(each, unit) for each in episodes)])
    if sizes := source["library_size"]:
        rows.append(["library", ", ".join(f"{n} terms for {f}" for f, n in sizes.items())])
    if left_out := source.get("library_left_out"):
        told = ", ".join(f"{term} {why}" for term, why in left_out.items())
        rows.append(["left out of it, for on the simulation", told])
    if noise := fit["noise_std"]:
        rows.append(["noise of the sensors, std", _noise(noise)])
    if fit["chi2"] is not None:
        rows.append(["χ² per sample of the fit", number(fit["chi2"])])
    if units := findings.get("units"):
        told = ", ".join(f"{name} in {shown(unit)}" for name, unit in units.items())
        rows.append(["units", told])
    return rows


def _episode(split: Mapping[str, Any], unit: str | None) -> str:
    end = measured(number(split["end"]), unit)
    span = f"{split['name']}, from {number(split['begin'])} to {end}"
    until = f"its first part, to {number(split['time_end'])}, tells its start"
    if split["held_out_whole"]:
        return f"{span}: held out whole; {until}"
    return f"{span}: fitted until {number(split['time_end'])}"


def _noise(noise: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {number(float(f'{std:.2g}'))}" for name, std in noise.items())
