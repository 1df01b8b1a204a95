"""Errors of the connection to an MLflow store, to its database and to its bucket."""

from __future__ import annotations

import sys

from dashred.core.errors import InputError
from dashred.core.system_errors import causes

INSTALL = "pip install 'dashred[servers]'"
# MLflow's names of the errors of a server, by status 503, and 500.
UNAVAILABLE = "TEMPORARILY_UNAVAILABLE"
FAILED = (UNAVAILABLE, "INTERNAL_ERROR")
# In MLflow's message about the answer of a proxy whose server is down: status 502 or 504.
PROXY = "failed with error code 50"


class StoreUnreachableError(InputError):
    """Nobody answers at the address of a store."""


def not_installed(package: str, need: str, where: str) -> InputError:
    """Return the error for an optional package that is missing."""
    return InputError(f"{need} needs the package {package}", where=where, hint=INSTALL)


def first_line(error: BaseException) -> str:
    """Return the first line of the text of an error, or the name of its class."""
    return next(iter(str(error).splitlines()), "") or type(error).__name__


def store_exceptions() -> tuple[type[Exception], ...]:
    """Return what MLflow raises: its own errors, and those of the packages that it connects with.

    boto3 and psycopg are optional, and imported only if a store needs them.
    """
    from mlflow.exceptions import MlflowException
    from requests.exceptions import RequestException
    from sqlalchemy.exc import SQLAlchemyError

    known: tuple[type[Exception], ...] = (MlflowException, RequestException, SQLAlchemyError)
    if "boto3" in sys.modules:
        from boto3.exceptions import Boto3Error
        from botocore.exceptions import BotoCoreError, ClientError

        known = (*known, Boto3Error, BotoCoreError, ClientError)
    if "psycopg" in sys.modules:
        from psycopg import Error

        known = (*known, Error)
    return (*known, StoreUnreachableError)


def is_outage(error: BaseException) -> bool:
    """Return whether a store has not answered, or has failed itself, so that it may answer later.

    A server that refuses a request is no outage: it would refuse it again.
    """
    return any(map(_is_outage, causes(error)))


def _is_outage(error: BaseException) -> bool:
    # A package that has not been imported has raised nothing, and importing MLflow takes seconds.
    if isinstance(error, StoreUnreachableError):
        return True
    if "botocore" in sys.modules and _is_outage_of_bucket(error):
        return True
    if "psycopg" in sys.modules and _is_outage_of_database(error):
        return True
    return "mlflow" in sys.modules and _is_outage_of_mlflow(error)


def _is_outage_of_mlflow(error: BaseException) -> bool:
    from mlflow.exceptions import MlflowException, RestException
    from requests.exceptions import ConnectionError, Timeout
    from sqlalchemy.exc import InterfaceError, OperationalError

    if isinstance(error, RestException):
        return error.error_code in FAILED
    if isinstance(error, MlflowException):
        return error.error_code == UNAVAILABLE or PROXY in str(error)
    return isinstance(error, ConnectionError | Timeout | InterfaceError | OperationalError)


def _is_outage_of_database(error: BaseException) -> bool:
    from psycopg import OperationalError

    return isinstance(error, OperationalError)


def _is_outage_of_bucket(error: BaseException) -> bool:
    from botocore.exceptions import ClientError, ConnectionError, HTTPClientError

    if isinstance(error, ClientError):
        return int(error.response.get("ResponseMetadata", {}).get("HTTPStatusCode", 0)) >= 500
    return isinstance(error, ConnectionError | HTTPClientError)
