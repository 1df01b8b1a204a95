"""One run in MLflow, and what can be logged to it: values, curves, tags, files.

Everything goes through a client with an explicit absolute URI, so no process depends on what
another library has set as MLflow's current run or store. MLflow is imported on first use: that
alone takes seconds.
"""

import json
import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, TypeVar

from dashred.core.findings.findings import write_json_atomic
from dashred.core.mlflow.metric_names import term_table
from dashred.core.mlflow.store import Store, refusals_as_failures

# What MLflow takes at once, and how long a value it keeps.
METRIC_BATCH, BATCH = 1000, 100
PARAM_LENGTH, TAG_LENGTH = 6000, 8000

# MLflow shows the text of this tag at the top of a run's page, and of an experiment's.
NOTE = "mlflow.note.content"

Entry = TypeVar("Entry")


class MlflowRun:
    """One run of the store, parent or nested, and what can be logged to it."""

    def __init__(self, store: Store, run_id: str) -> None:
        """Bind to a run that exists in the store."""
        self.run_id = run_id
        self.artifact_dir: Path = store.artifact_dir(run_id)
        self._store = store
        # What an attempt that was cut short has logged: its points are not drawn twice.
        self._begun = self._keys_logged()

    @property
    def uri(self) -> str:
        """The store's URI, as `mlflow ui --backend-store-uri` wants it."""
        return self._store.uri

    def log_params(self, params: Mapping[str, Any]) -> None:
        """Log a flat dict of plain values; a value too long for MLflow is cut, ending in `…`."""
        from mlflow.entities import Param

        entries = [Param(key, _text(value, PARAM_LENGTH)) for key, value in params.items()]
        for part in _parts(entries, BATCH):
            self._batch(params=part)

    def log_metrics(self, metrics: Mapping[str, float], step: int) -> None:
        """Log one point of each curve; what is not finite becomes NaN, a gap in the curve."""
        from mlflow.entities import Metric

        now = int(time.time() * 1000)
        # MLflow would store an infinity as 1.8e308, and no curve could be read beside that.
        points = {key: float(v) if math.isfinite(v) else math.nan for key, v in metrics.items()}
        entries = [
            Metric(key, value, now, step)
            for key, value in points.items()
            if (step, value) not in self._logged(key)
        ]
        for part in _parts(entries, METRIC_BATCH):
            self._batch(metrics=part)

    def set_tags(self, tags: Mapping[str, Any]) -> None:
        """Set tags such as system, verdict and git commit."""
        from mlflow.entities import RunTag

        entries = [RunTag(key, _text(value, TAG_LENGTH)) for key, value in tags.items()]
        for part in _parts(entries, BATCH):
            self._batch(tags=part)

    def describe_experiment(self, text: str) -> None:
        """Say what the run's experiment is about, unless somebody has said so already."""
        with self._writing():
            experiment = self._store.client.get_experiment(self._store.experiment_id)
            if NOTE not in experiment.tags:
                self._store.client.set_experiment_tag(experiment.experiment_id, NOTE, text)

    def log_terms(self, terms: Iterable[str]) -> None:
        """Write `terms.json`: from the last part of a coefficient's metric name to its term."""
        path = self.artifact_dir / "terms.json"
        write_json_atomic(path, term_table(terms))
        self.log_file(path)

    def log_file(self, path: Path) -> None:
        """Copy a file to the top of the run's artifacts, unless it lies among them already."""
        if not self._holds(path):
            with self._writing():
                self._store.client.log_artifact(self.run_id, str(path))

    def log_files(self, paths: Iterable[Path]) -> None:
        """Copy files to the top of the run's artifacts, but those that lie among them already."""
        for path in paths:
            self.log_file(path)

    def new_model(self, name: str) -> str:
        """Open a model of the run's, in the run's own experiment; returns its id."""
        with self._writing():
            opened = self._store.client.create_logged_model(
                self._store.experiment_id, name=name, source_run_id=self.run_id
            )
        return str(opened.model_id)

    def fetch_artifacts(self, folder: Path) -> None:
        """Copy the run's artifacts to a folder, unless it holds them already."""
        if not self._holds(folder):
            with self._writing():
                self._store.client.download_artifacts(self.run_id, "", str(folder))

    def _holds(self, path: Path) -> bool:
        here = path.resolve().is_relative_to(self.artifact_dir.resolve())
        return here and not self._store.remote

    def _keys_logged(self) -> dict[str, set[tuple[int, float]] | None]:
        """The metrics that the run has already, their points yet unread."""
        with self._writing():
            return dict.fromkeys(self._store.client.get_run(self.run_id).data.metrics)

    def _logged(self, key: str) -> set[tuple[int, float]]:
        if key not in self._begun:
            return set()
        points = self._begun[key]
        if points is None:
            with self._writing():
                history = self._store.client.get_metric_history(self.run_id, key)
            points = self._begun[key] = {(point.step, point.value) for point in history}
        return points

    def _batch(self, **entries: Any) -> None:
        with self._writing():
            self._store.client.log_batch(self.run_id, **entries)

    def _writing(self) -> AbstractContextManager[None]:
        hint = f"go on, once it can be used again, with resume={self.run_id}"
        return refusals_as_failures(self._store.uri, hint)


def flatten(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """A nested dict as a flat one with dotted keys: `{"shred": {"lags": 8}}` → `shred.lags`."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping) and value:
            flat |= flatten(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def _text(value: Any, length: int) -> str:
    text = value if isinstance(value, str) else json.dumps(value, default=str)
    return text if len(text) <= length else f"{text[: length - 1]}…"


def _parts(entries: Sequence[Entry], size: int) -> Iterator[Sequence[Entry]]:
    for start in range(0, len(entries), size):
        yield entries[start : start + size]
