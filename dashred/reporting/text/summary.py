"""The printed summary: the verdict, the data, the errors, the proposals, and the files."""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from dashred.core.findings.methods import AT_SENSORS, method_label
from dashred.core.formatting import PLUS_MINUS, sentence
from dashred.core.units import NO_UNITS, TIME, with_unit
from dashred.reporting.text.fitted_parameters import TITLE, fitted_parameter_lines
from dashred.reporting.text.improvement import count_text
from dashred.reporting.text.verdict import verdict_lines

if TYPE_CHECKING:
    from rich.console import Console

# In the order in which a reader should meet them.
METHODS = (*AT_SENSORS, "corrected_shred", "observer")
ALGORITHMS = {
    "alg1": "Algorithm 1",
    "alg2": "Algorithm 2",
    "dynamics": "Assimilation with dynamics",
}
MOST_TERMS = 5
# A smaller part of the field that the modes of SHRED cannot express is not told, in std.
LEAST_LEFT_OUT = 1e-3
HELD_OUT = {
    "test_sensors": "Test sensors, not used in any fit",
    "heldout_time": "Held-out time, the end of the recording",
    "heldout_restarted": "Held-out time, from a state fitted just before it",
    "heldout_episode": "Held-out episode",
}


def summary(
    findings: Mapping[str, Any], score: Mapping[str, Any] | None, paths: Mapping[str, Any]
) -> str:
    """Return the run as text, from `findings.json`, `score.json` (of twins), and paths.

    Errors are RMSEs in units of the standard deviation of what is compared.
    """
    fit = findings["fit"]
    samples = fit.get("held_out_samples", {})
    told = [verdict_lines(findings), _fitted_parameters(findings)]
    blocks = [
        *told,
        [f"{PLUS_MINUS}."] if any("±" in line for block in told for line in block) else [],
        _budget(findings.get("budget")),
        _compared(findings["input"], findings.get("units", NO_UNITS)),
        *(
            _errors(f"{title}{count_text(samples.get(key))}", fit.get(key) or {})
            for key, title in HELD_OUT.items()
        ),
        _errors(
            "Whole field, compared with the hidden truth", (score or {}).get("field_rmse") or {}
        ),
        _basis(fit.get("outside_basis")),
        _proposals(findings["latent"]),
        _paths(paths),
    ]
    return "\n\n".join("\n".join(block) for block in blocks if block) + "\n"


def print_summary(text: str, console: "Console | None" = None) -> None:
    """Print the summary without interpreting markup and without wrapping lines."""
    from rich.console import Console
    from rich.text import Text

    console = console or Console()
    console.rule("dashred")
    console.print(Text(text.rstrip()), soft_wrap=True)


def _fitted_parameters(findings: Mapping[str, Any]) -> list[str]:
    lines = fitted_parameter_lines(findings)
    return [f"{TITLE}:", *(f"  {line}" for line in lines)] if lines else []


def _budget(budget: Mapping[str, Any] | None) -> list[str]:
    if budget is None:
        return []
    left_out = ", ".join(budget["not_tried"])
    cpu = f", {budget['cpu']:g} s of CPU" if "cpu" in budget else ""
    return [
        f"Some stages used up their share of the budget of {budget['seconds']:g} s (the run took "
        f"{budget['spent']:g} s{cpu}). Not tried or ended early: {left_out}. To allow more time, "
        "set budget=SECONDS."
    ]


def _compared(source: Mapping[str, Any], units: Mapping[str, str]) -> list[str]:
    title = source["config"].get("system", {}).get("title", "The system")
    lines = [f"{title}: the simulation compared with recorded sensors (seed {source['seed']})."]
    splits = source.get("splits")
    if not splits:
        return lines
    fitted = len(splits["inputs"]) + len(splits["extra"])
    inputs = _count(len(splits["inputs"]), "input")
    counts = [f"{_count(fitted, 'sensor')} for the fit ({inputs} of SHRED)"]
    for role, purpose in (("validate", "for validation"), ("test", "for the test")):
        if splits[role]:
            counts.append(f"{len(splits[role])} {purpose}")
    unit = units.get(TIME)
    until = with_unit(f"{splits['time_end']:.6g}", unit)
    lines.append(f"{', '.join(counts)}; the fit ends at time {until}.")
    lines += [sentence(splits["note"])] if splits.get("note") else []
    return lines + [sentence(_episode(episode, unit)) for episode in splits.get("episodes", [])]


def _episode(episode: Mapping[str, Any], unit: str | None) -> str:
    begin, end, until = (f"{episode[key]:.6g}" for key in ("begin", "end", "time_end"))
    fitted = f"fitted until {with_unit(until, unit)}"
    if episode["held_out_whole"]:
        fitted = f"held out, its start {fitted}"
    return f"episode {episode['name']}, {begin} to {with_unit(end, unit)}: {fitted}"


def _errors(title: str, errors: Mapping[str, float | None]) -> list[str]:
    known = [(method_label(key), errors[key]) for key in METHODS if errors.get(key) is not None]
    if not known:
        return []
    width = max(len(name) for name, _ in known)
    table = [f"  {name:<{width}}  {value:8.3g}" for name, value in known]
    return [f"{title}: RMSE in standard deviations", *table, *_compare(errors)]


def _compare(errors: Mapping[str, float | None]) -> Iterator[str]:
    before, after = errors.get("shred") or errors.get("shred_plain"), errors.get("dashred")
    if not before or after is None:
        return
    change = 1 - after / before
    if abs(change) < 0.01:
        yield "  Assimilation changed SHRED's error by less than 1 %."
    else:
        word = "lowered" if change > 0 else "raised"
        yield f"  Assimilation {word} SHRED's error by {abs(change):.0%}.".replace("%", " %")


def _basis(share: float | None) -> list[str]:
    if share is None or share < LEAST_LEFT_OUT:
        return []
    rms = f"{share:.2g} standard deviations (RMS)"
    return [f"The modes of SHRED cannot express {rms} of the corrected field."]


def _proposals(latent: Mapping[str, Any]) -> list[str]:
    known = {name: latent[key] for key, name in ALGORITHMS.items() if latent.get(key)}
    if not known:
        return []
    lines = ["Proposals of latent SINDy (to be tested, not a verdict):"]
    for name, found in known.items():
        kept = [proposal for proposal in found["proposals"] if proposal["coefficient"] != 0]
        terms = sorted(kept, key=lambda proposal: proposal["rank"])
        changes = found.get("parameters") or {}
        lines += [
            f"  {name}: {'' if terms or changes else 'no term'}".rstrip(),
            *_terms(terms[:MOST_TERMS]),
            *(f"    the parameter {p} changes by {change:+.4g}" for p, change in changes.items()),
        ]
        if len(terms) > MOST_TERMS:
            lines.append(f"    and {len(terms) - MOST_TERMS} more, in findings.json")
    return lines


def _terms(proposals: Sequence[Mapping[str, Any]]) -> list[str]:
    names = [f"{p['coefficient']:+.4g} · {p['term']}" for p in proposals]
    width = max((len(name) for name in names), default=0)
    lines = []
    for proposal, name in zip(proposals, names, strict=True):
        line = f"    {proposal['rank']}. {name:<{width}}  in the equation of {proposal['equation']}"
        if proposal["inclusion"] is not None:
            line += f", in {proposal['inclusion']:.0%} of the resamples".replace("%", " %")
        lines.append(line)
    return lines


def _paths(paths: Mapping[str, Any]) -> list[str]:
    width = max((len(name) for name in paths), default=0)
    return [f"{name:<{width}}  {path}" for name, path in paths.items()]


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
