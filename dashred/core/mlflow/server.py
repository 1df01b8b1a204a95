"""A tracking server elsewhere, in place of a store on this disk: ``tracking.root=http://...``."""

from __future__ import annotations

import os
from http.client import HTTPException
from typing import TYPE_CHECKING
from urllib.error import HTTPError
from urllib.request import urlopen

from dashred.core.errors import InputError
from dashred.core.files.user_path import is_server

if TYPE_CHECKING:
    from mlflow import MlflowClient

# MLflow's own seven tries, each after twice the wait, would hold a run up for minutes.
os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "4")
os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "30")

ANSWER_SECONDS = 10


def open_server(url: str) -> MlflowClient:
    """Return a client of a server that answers.

    Raises:
        InputError: it does not.
    """
    check_server(url)
    from mlflow import MlflowClient

    return MlflowClient(tracking_uri=url)


def check_server(root: str) -> None:
    """Knock at the server, if `tracking.root` is one's URL: better now than after an hour.

    Raises:
        InputError: it does not answer.
    """
    if not is_server(root):
        return
    try:
        with urlopen(f"{root.rstrip('/')}/health", timeout=ANSWER_SECONDS):
            pass
    except HTTPError:
        pass  # It answers; what it wants, such as a password, MLflow itself will tell.
    except (OSError, ValueError, HTTPException) as error:
        reason = getattr(error, "reason", error) or type(error).__name__
        raise InputError(
            f"no MLflow server answers: {reason}",
            where=root,
            hint="start it (mlflow server), or keep runs on this disk with tracking.root=DIR",
        ) from None
