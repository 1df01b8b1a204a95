"""Connection to an MLflow tracking server: ``tracking.root=http://...``."""

from __future__ import annotations

import os
from http.client import HTTPException
from typing import TYPE_CHECKING
from urllib.error import HTTPError
from urllib.request import urlopen

from dashred.core.mlflow.connection_errors import StoreUnreachableError

if TYPE_CHECKING:
    from mlflow import MlflowClient

# By default MLflow makes seven attempts with doubling delays, which would block a run for minutes.
# A run repeats its requests itself.
os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "2")
os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "30")

RESPONSE_TIMEOUT = 10


def open_server(url: str) -> MlflowClient:
    """Return a client of a tracking server.

    Raises:
        StoreUnreachableError: the server does not respond.
    """
    check_server(url)
    from mlflow import MlflowClient

    return MlflowClient(tracking_uri=url)


def check_server(root: str) -> None:
    """Check that the tracking server at an address responds.

    Raises:
        StoreUnreachableError: it does not.
    """
    try:
        with urlopen(f"{root.rstrip('/')}/health", timeout=RESPONSE_TIMEOUT):
            pass
    except HTTPError:
        pass  # The server responds; MLflow reports other problems, such as a missing password.
    except (OSError, ValueError, HTTPException) as error:
        reason = getattr(error, "reason", error) or type(error).__name__
        raise StoreUnreachableError(
            f"no MLflow server responds: {reason}",
            where=root,
            hint="start it (mlflow server), or use a local store with tracking.root=DIR",
        ) from None
