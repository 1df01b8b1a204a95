"""Names, tags, notes and headline numbers of the runs in MLflow's list.

All of it is written before a seal is opened, so it holds nothing of a twin's truth.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dashred.config import Config, frozen_input
from dashred.core.findings.schema import Findings
from dashred.core.mlflow.metric_names import metric_name
from dashred.core.mlflow.run import NOTE, MlflowRun, flatten
from dashred.core.mlflow.tracker import Tracker
from dashred.reporting.text.verdict import verdict_lines

MOST_IN_A_NAME = 3
PROOFS = {"test_sensors": "test sensors", "heldout_time": "held-out time"}

EXPERIMENT = """\
**{title}**: what does its simulation leave out? One run a command of `dashred train`;
its stages are nested below it.

- *Which run is the best?* Sort by `test_sensors/corrected`: the RMSE of the corrected simulation at
  sensors that no fit has seen, in standard deviations. `gain/test_sensors` is by how much it beats
  the simulation's own best.
- *Compare:* tick several runs, then **Compare**. `coef/<equation>/<term>` are the coefficients that
  were found, `assimilate/rmse/sensors_validate` and `horizon/chi2` are curves; `terms.json` tells a
  slug's term.
- *Read:* a run's note says what was found; its artifacts hold `report.html` and `findings.json`.
"""


def name_of(config: Config) -> str:
    """Return the name of a run that has found nothing yet."""
    return f"{config.name} seed {config.seed}"


def describe(run: MlflowRun, config: Config, git_commit: str) -> None:
    """Log what a run is of."""
    run.log_params(flatten(frozen_input(config)))
    run.set_tags({"system": config.name, "seed": config.seed, "git commit": git_commit})
    run.describe_experiment(EXPERIMENT.format(title=config.system.title or config.name))


def conclude(run: Tracker, config: Config, findings: Findings, output: Path) -> None:
    """Name the run by what it found, and log what it can be found and compared by."""
    run.log_metrics(headline(findings), 0)
    run.log_terms(term["term"] for term in findings["terms"] or [])
    run.set_tags({"verdict": findings["verdict"] or "none yet", NOTE: note(findings, output)})
    run.rename(run.run_id, f"{name_of(config)}: {short_verdict(findings)}")


def headline(findings: Mapping[str, Any]) -> dict[str, float]:
    """Return the numbers that runs are sorted and compared by.

    ``test_sensors/…`` and ``heldout_time/…`` are RMSEs in std, ``gain/…`` how many times smaller
    the corrected simulation's is than the simulation's own best, ``coef/…`` the law.
    """
    found: dict[str, float | None] = {"chi2": findings["fit"]["chi2"]}
    for proof in PROOFS:
        errors = findings["fit"][proof]
        found |= {f"{proof}/{method}": value for method, value in errors.items()}
        refit, corrected = errors["simulation_refit"], errors["corrected"]
        if refit and corrected:
            found[f"gain/{proof}"] = refit / corrected
    for term in findings["terms"] or []:
        name = metric_name("coef", term["equation"] or "parameter", term["term"])
        found[name] = term["coefficient"]
    return {name: float(value) for name, value in found.items() if value is not None}


def short_verdict(findings: Mapping[str, Any]) -> str:
    """Return ``missing-term: u, u**3``."""
    terms = [term["term"] for term in findings["terms"] or []]
    more = ["…"] if len(terms) > MOST_IN_A_NAME else []
    listed = ", ".join([*terms[:MOST_IN_A_NAME], *more])
    return f"{findings['verdict']}{': ' if listed else ''}{listed}"


def note(findings: Mapping[str, Any], output: Path) -> str:
    """Return the verdict in plain words and where the report is, as Markdown."""
    head, *lines = verdict_lines(findings) or ["There is no verdict yet."]
    points = "\n".join(f"- {_escaped(line.strip())}" for line in lines)
    place = f"The whole report is `report.html` among the artifacts, and in `{output}`."
    return f"**{_escaped(head)}**\n\n{points}\n\n{place}\n"


def _escaped(text: str) -> str:
    """Return a text in which Markdown takes no star or underscore of a formula for its own."""
    return "".join(f"\\{sign}" if sign in "\\*_`[]<>#|" else sign for sign in text)
