"""Check before a run that its MLflow store can be reached."""

from __future__ import annotations

from dashred.core.mlflow.bucket import check_bucket
from dashred.core.mlflow.database import check_database
from dashred.core.mlflow.server import check_server
from dashred.core.mlflow.store_address import is_database, is_server


def check_store(root: str, artifacts: str | None) -> None:
    """Check that a server, a database and a bucket respond; a folder is checked when it is opened.

    Nothing is written.

    Args:
        root: ``tracking.root``.
        artifacts: ``tracking.artifacts``.

    Raises:
        InputError: one of them does not respond, or refuses the user.
    """
    if is_database(root):
        check_database(root)
    elif is_server(root):
        check_server(root)
    if artifacts is not None:
        check_bucket(artifacts)
