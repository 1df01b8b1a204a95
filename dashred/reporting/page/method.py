"""Tables of the report on the method and the provenance of an analysis."""

from collections.abc import Iterable, Mapping
from typing import Any

from dashred.core.formatting import number
from dashred.core.units import NO_UNITS, TIME, format_unit, with_unit


def method_rows(findings: Mapping[str, Any]) -> dict[str, str]:
    """Return rows on the data, the library and the noise, by label."""
    source, fit, units = findings["input"], findings["fit"], findings.get("units", NO_UNITS)
    splits = source["splits"] or {}
    rows = {
        "inputs of SHRED": ", ".join(splits.get("inputs", ())),
        "further fit sensors": ", ".join(splits.get("extra", ())),
        "validation sensors": ", ".join(splits.get("validate", ())),
        "test sensors": ", ".join(splits.get("test", ())),
        "episodes": "; ".join(
            _episode(each, units.get(TIME)) for each in splits.get("episodes") or ()
        ),
        "library": _join("{1} terms for {0}", (source["library_size"] or {}).items()),
        "left out of the library": _join("{} {}", (source.get("library_left_out") or {}).items()),
        "noise of the sensors, stated or estimated from their traces, std": _stds(fit["noise_std"]),
        "residuals of the fit, std": _stds(fit.get("residual_std")),
        "χ² per sample of the law, relative to these residuals": (
            "" if fit["chi2"] is None else number(fit["chi2"])
        ),
        "units": _join("{} in {}", ((name, format_unit(unit)) for name, unit in units.items())),
    }
    return {name: text for name, text in rows.items() if text}


def provenance_rows(findings: Mapping[str, Any], commit: str | None) -> dict[str, str]:
    """Return rows on everything that determines the findings, by label.

    Args:
        findings: the content of ``findings.json``.
        commit: git commit of dashred, or None.
    """
    source = findings["input"]
    recording = source["config"].get("recording", {})
    versions = sorted(source["versions"].items())
    rows = {
        "configuration, sha256": source["config_sha256"],
        "recording": recording.get("path"),
        "table of sensors": recording.get("sensors"),
        "snapshots": source["config"].get("system", {}).get("snapshots"),
        "recording's values, sha256": source["recording_sha256"],
        "seed": str(source["seed"]),
        "dashred, git commit": commit,
        "versions": _join("{} {}", versions),
        "snapshots' values, sha256": source.get("snapshots_sha256"),
        "corrected simulation": findings["corrected"],
    }
    # The sensors of a twin are a number, not a file.
    return {name: text for name, text in rows.items() if isinstance(text, str) and text}


def _stds(by_sensor: Mapping[str, float] | None) -> str:
    stds = (by_sensor or {}).items()
    return _join("{} {}", ((name, number(float(f"{std:.2g}"))) for name, std in stds))


def _join(form: str, pairs: Iterable[tuple[str, Any]]) -> str:
    return ", ".join(form.format(*pair) for pair in pairs)


def _episode(split: Mapping[str, Any], unit: str | None) -> str:
    end = with_unit(number(split["end"]), unit)
    span = f"{split['name']}, from {number(split['begin'])} to {end}"
    until = f"its first part, to {number(split['time_end'])}, determines its start"
    if split["held_out_whole"]:
        return f"{span}: held out; {until}"
    return f"{span}: fitted until {number(split['time_end'])}"
