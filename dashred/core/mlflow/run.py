"""Logging of parameters, metrics, tags and files to an MLflow run.

All calls use a client with an explicit absolute URI, so they do not depend on MLflow's current
run or store. MLflow is imported on first use, because the import takes seconds.
"""

import json
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from dashred.core.findings.findings import write_json_atomic
from dashred.core.mlflow.metric_names import term_table
from dashred.core.mlflow.store import Store
from dashred.core.mlflow.store_requests import Requests

# Limits of MLflow: entries per request, and characters per value.
METRIC_BATCH, BATCH = 1000, 100
PARAM_LENGTH, TAG_LENGTH = 6000, 8000
# Seconds between requests that send metrics: each of them waits for the disk or the network.
SEND_EVERY = 5.0
# The same while a server does not answer: each attempt may hold the run up for seconds.
RETRY_EVERY = 60.0

# MLflow shows the text of this tag at the top of the page of a run or experiment.
NOTE = "mlflow.note.content"

Entry = TypeVar("Entry")
Answer = TypeVar("Answer")


class MlflowRun:
    """A parent or nested run of the store."""

    def __init__(self, store: Store, run_id: str, requests: Requests) -> None:
        """Attach to an existing run of the store."""
        self.run_id = run_id
        self.artifact_dir: Path = store.artifact_dir(run_id)
        self._store, self._requests = store, requests
        # Points that an interrupted attempt has logged are not logged twice.
        self._known_points = self._known_metrics()
        self._waiting: list[Any] = []
        self._send_at = -math.inf

    @property
    def uri(self) -> str:
        """URI of the store, as for ``mlflow ui --backend-store-uri``."""
        return self._store.uri

    @property
    def tracking_uri(self) -> str:
        """URI of the store for ``mlflow.set_tracking_uri`` in this process."""
        return str(self._store.client.tracking_uri)

    def request(self, send: Callable[[], Answer]) -> Answer:
        """Return the answer of the store, and wait for a server that does not answer.

        Raises:
            ExternalServiceError: the store refuses the request, or has not answered for minutes.
        """
        return self._requests.send(send)

    def log_params(self, params: Mapping[str, Any]) -> None:
        """Log a flat dict of plain values; a value too long for MLflow is truncated with ``…``."""
        from mlflow.entities import Param

        entries = [Param(key, _text(value, PARAM_LENGTH)) for key, value in params.items()]
        for part in chunks(entries, BATCH):
            self._batch(params=part)

    def log_metrics(self, metrics: Mapping[str, float], step: int) -> None:
        """Log one point of each metric; a non-finite value becomes NaN, a gap in the curve.

        Points are sent every few seconds, and the last ones when the run ends. They wait while a
        server does not answer.
        """
        from mlflow.entities import Metric

        now = int(time.time() * 1000)
        # MLflow would store infinity as 1.8e308, which ruins the scale of a plot.
        points = {key: float(v) if math.isfinite(v) else math.nan for key, v in metrics.items()}
        self._waiting += [
            Metric(key, value, now, step)
            for key, value in points.items()
            if (step, value) not in self._logged(key)
        ]
        if time.monotonic() >= self._send_at:
            answers = self._requests.attempt(self._send_waiting)
            self._send_at = time.monotonic() + (SEND_EVERY if answers else RETRY_EVERY)

    def send_metrics(self) -> None:
        """Send the points that are waiting."""
        self.request(self._send_waiting)

    def _send_waiting(self) -> None:
        while self._waiting:
            self._store.client.log_batch(self.run_id, metrics=self._waiting[:METRIC_BATCH])
            del self._waiting[:METRIC_BATCH]

    def set_tags(self, tags: Mapping[str, Any]) -> None:
        """Set tags such as system, verdict and git commit."""
        from mlflow.entities import RunTag

        entries = [RunTag(key, _text(value, TAG_LENGTH)) for key, value in tags.items()]
        for part in chunks(entries, BATCH):
            self._batch(tags=part)

    def describe_experiment(self, text: str) -> None:
        """Set the description of the run's experiment, unless it has one."""
        client, experiment_id = self._store.client, self._store.experiment_id
        if NOTE not in self.request(lambda: client.get_experiment(experiment_id)).tags:
            self.request(lambda: client.set_experiment_tag(experiment_id, NOTE, text))

    def log_terms(self, terms: Iterable[str]) -> None:
        """Write ``terms.json``: last part of a coefficient's metric name → term."""
        path = self.artifact_dir / "terms.json"
        write_json_atomic(path, term_table(terms))
        self.log_file(path)

    def log_file(self, path: Path) -> None:
        """Copy a file to the run's artifacts, unless it is among them already."""
        if not self._is_stored(path):
            self.request(lambda: self._store.client.log_artifact(self.run_id, str(path)))

    def log_files(self, paths: Iterable[Path]) -> None:
        """Copy files to the run's artifacts, except files that are among them already."""
        for path in paths:
            self.log_file(path)

    def new_model(self, name: str) -> str:
        """Create a logged model of this run and return its id."""
        opened = self.request(
            lambda: self._store.client.create_logged_model(
                self._store.experiment_id, name=name, source_run_id=self.run_id
            )
        )
        return str(opened.model_id)

    def fetch_artifacts(self, folder: Path) -> None:
        """Copy the run's artifacts to a folder, unless they are there already."""
        if not self._is_stored(folder):
            self.request(
                lambda: self._store.client.download_artifacts(self.run_id, "", str(folder))
            )

    def _is_stored(self, path: Path) -> bool:
        here = path.resolve().is_relative_to(self.artifact_dir.resolve())
        return here and not self._store.remote

    def _known_metrics(self) -> dict[str, set[tuple[int, float]] | None]:
        """Return the names of the metrics that the run already has; their points are read later."""
        found = self.request(lambda: self._store.client.get_run(self.run_id))
        return dict.fromkeys(found.data.metrics)

    def _logged(self, key: str) -> set[tuple[int, float]]:
        if key not in self._known_points:
            return set()
        points = self._known_points[key]
        if points is None:
            history = self.request(lambda: self._store.client.get_metric_history(self.run_id, key))
            points = self._known_points[key] = {(point.step, point.value) for point in history}
        return points

    def _batch(self, **entries: Any) -> None:
        self.request(lambda: self._store.client.log_batch(self.run_id, **entries))


def flatten(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Flatten a nested dict with dotted keys: ``{"shred": {"lags": 8}}`` → ``shred.lags``."""
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


def chunks(entries: Sequence[Entry], size: int) -> Iterator[Sequence[Entry]]:
    """Yield the entries in parts of at most ``size``."""
    for start in range(0, len(entries), size):
        yield entries[start : start + size]
