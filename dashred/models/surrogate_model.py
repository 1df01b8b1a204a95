"""The corrected surrogate as an MLflow model, loaded with ``mlflow.pytorch.load_model``.

The model is stored as an exported graph (PyTorch's ``pt2``), not as a pickle: loading it runs no
code from the file and needs only torch and MLflow.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import metadata
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from dashred.models.quiet_export import quiet_export
from dashred.models.shred import SHRED

if TYPE_CHECKING:
    from dashred.core.mlflow.run import MlflowRun

MODEL_NAME = "corrected_shred"
# Windows in the example; with only one, the graph would be specialised to batches of one.
EXAMPLES = 2
REQUIREMENTS = ("torch", "mlflow")


def log_surrogate(run: MlflowRun, shred: SHRED, windows: Tensor, sensors: list[str]) -> str:
    """Log the network, float32 ``(batch, lag, sensor)`` → ``(batch, field, *grid)``.

    Args:
        run: that gets the model.
        shred: the network.
        windows: of the recording, ``(time, lag, sensor)``.
        sensors: names of the input's columns.

    Returns:
        The model URI for ``mlflow.pytorch.load_model``, with the tracking URI of the run.
    """
    import mlflow
    from mlflow.models import Model, infer_signature

    example = windows[:EXAMPLES].float().contiguous()
    with torch.no_grad():
        field = shred(example)
    with _tracking_uri_of(run), quiet_export():
        logged = Model.log(
            artifact_path=None,
            model_id=run.new_model(MODEL_NAME),
            flavor=mlflow.pytorch,
            run_id=run.run_id,
            pytorch_model=shred.train(False),
            signature=infer_signature(example.numpy(), field.numpy()),
            input_example=example.numpy(),
            serialization_format="pt2",
            metadata={"sensors": sensors},
            pip_requirements=[f"{name}=={metadata.version(name)}" for name in REQUIREMENTS],
        )
    return str(logged.model_uri)


@contextmanager
def _tracking_uri_of(run: MlflowRun) -> Iterator[None]:
    """Set MLflow's tracking URI to that of the run, temporarily."""
    import mlflow

    before = mlflow.get_tracking_uri()
    mlflow.set_tracking_uri(run.tracking_uri)
    try:
        yield
    finally:
        mlflow.set_tracking_uri(before)
