"""The MLflow experiment that a run belongs to."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dashred.core.errors import InputError

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import Experiment


def find_experiment(
    client: MlflowClient, name: str, artifacts: str | None, *, must_exist: bool = False
) -> Experiment:
    """Return the experiment, which is created if it is missing.

    Args:
        client: of the store.
        name: of the experiment.
        artifacts: folder or bucket of its artifacts; None if the server chooses it, or if the
            experiment has one.
        must_exist: whether it is an error if the experiment is missing.

    Raises:
        InputError: it is missing, was deleted, or its artifacts are elsewhere.
    """
    found = client.get_experiment_by_name(name)
    if found is None and must_exist:
        hint = "give the bucket of its artifacts: tracking.artifacts=s3://BUCKET/FOLDER"
        raise InputError("this experiment is not in the database yet", where=name, hint=hint)
    if found is None:
        found = _create_experiment(client, name, artifacts)
    hint = "choose another name with tracking.experiment=NAME"
    if found.lifecycle_stage != "active":
        raise InputError("this experiment was deleted in MLflow", where=name, hint=hint)
    if artifacts is not None and found.artifact_location != artifacts:
        what = f"the artifacts of this experiment are elsewhere: {found.artifact_location}"
        moved = "the store was moved or created by another program"
        raise InputError(what, where=name, hint=f"{moved}; {hint}")
    return found


def _create_experiment(client: MlflowClient, name: str, artifacts: str | None) -> Experiment:
    from mlflow.exceptions import MlflowException

    try:
        return client.get_experiment(client.create_experiment(name, artifact_location=artifacts))
    except MlflowException as error:
        # On a server, another run may have created it since we asked.
        if error.error_code != "RESOURCE_ALREADY_EXISTS":
            raise
        found = client.get_experiment_by_name(name)
        assert found is not None
        return found
