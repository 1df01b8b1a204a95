"""Names, tags, notes and summary metrics of a run in MLflow.

They contain nothing of a twin's truth, because they are written before its seal is opened.
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

MAX_TERMS = 3
TESTS = {"test_sensors": "test sensors", "heldout_time": "held-out time"}

EXPERIMENT = """\
**{title}**: what does the simulation leave out? Each command `dashred train` is one run;
its stages are nested below it.

- *Find the best run:* Sort by `test_sensors/corrected`: the RMSE of the corrected simulation at
  sensors that were not fitted, in standard deviations. `gain/test_sensors` is the ratio of the
  RMSE of the refitted simulation to it.
- *Compare:* Select several runs, then **Compare**. `coef/<equation>/<term>` are the coefficients
  found, `assimilate/rmse/sensors_validate` and `horizon/chi2` are curves; `terms.json` maps a
  slug to its term.
- *Read:* The note of a run summarises its findings; its artifacts include `report.html` and
  `findings.json`.
"""


def run_name(config: Config) -> str:
    """Return the name of a run that has no findings yet."""
    return f"{config.name} seed {config.seed}"


def log_input(run: MlflowRun, config: Config, git_commit: str) -> None:
    """Log the input of a run and describe its experiment."""
    run.log_params(flatten(frozen_input(config)))
    run.set_tags({"system": config.name, "seed": config.seed, "git commit": git_commit})
    run.describe_experiment(EXPERIMENT.format(title=config.system.title or config.name))


def log_result(run: Tracker, config: Config, findings: Findings, output: Path) -> None:
    """Log the summary metrics, terms and verdict of a run, and rename it by its verdict."""
    run.log_metrics(headline_metrics(findings), 0)
    run.log_terms(term["term"] for term in findings["terms"] or [])
    run.set_tags({"verdict": findings["verdict"] or "none yet", NOTE: note(findings, output)})
    run.rename(run.run_id, f"{run_name(config)}: {short_verdict(findings)}")


def headline_metrics(findings: Mapping[str, Any]) -> dict[str, float]:
    """Return the metrics by which runs are sorted and compared.

    ``test_sensors/…`` and ``heldout_time/…`` are RMSEs in std, ``gain/…`` is the RMSE of the
    refitted simulation over that of the corrected one, ``coef/…`` are the coefficients of the law.
    """
    metrics: dict[str, float | None] = {"chi2": findings["fit"]["chi2"]}
    for test in TESTS:
        errors = findings["fit"][test]
        metrics |= {f"{test}/{method}": value for method, value in errors.items()}
        refit, corrected = errors["simulation_refit"], errors["corrected"]
        if refit and corrected:
            metrics[f"gain/{test}"] = refit / corrected
    for term in findings["terms"] or []:
        name = metric_name("coef", term["equation"] or "parameter", term["term"])
        metrics[name] = term["coefficient"]
    return {name: float(value) for name, value in metrics.items() if value is not None}


def short_verdict(findings: Mapping[str, Any]) -> str:
    """Return ``missing-term: u, u**3``."""
    terms = [term["term"] for term in findings["terms"] or []]
    more = ["…"] if len(terms) > MAX_TERMS else []
    listed = ", ".join([*terms[:MAX_TERMS], *more])
    return f"{findings['verdict']}{': ' if listed else ''}{listed}"


def note(findings: Mapping[str, Any], output: Path) -> str:
    """Return the verdict and the location of the report, as Markdown."""
    head, *lines = verdict_lines(findings) or ["There is no verdict yet."]
    points = "\n".join(f"- {_escaped(line.strip())}" for line in lines)
    place = f"The full report is `report.html`, among the artifacts and in `{output}`."
    return f"**{_escaped(head)}**\n\n{points}\n\n{place}\n"


def _escaped(text: str) -> str:
    """Escape the characters of a formula that Markdown would interpret."""
    return "".join(f"\\{sign}" if sign in "\\*_`[]<>#|" else sign for sign in text)
