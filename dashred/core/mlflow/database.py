"""Connection to an MLflow store in PostgreSQL: ``tracking.root=postgresql://USER@HOST/DATABASE``.

libpq finds the password in ``PGPASSWORD`` or ``~/.pgpass``; it is never part of an address.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl, urlencode, urlsplit, urlunsplit

from dashred.core.errors import InputError
from dashred.core.mlflow.connection_errors import (
    StoreUnreachableError,
    first_line,
    not_installed,
)
from dashred.core.mlflow.store_address import DATABASE

if TYPE_CHECKING:
    from mlflow import MlflowClient

# SQLAlchemy's name of the driver. Its default depends on its version.
DRIVER = "postgresql+psycopg"
# Of libpq, unless the address sets them: seconds until a connection is given up, and milliseconds
# until one that has broken without a word is.
LIMITS = {"connect_timeout": "5", "tcp_user_timeout": "30000"}
# Key of the lock of a database that is being opened: the number of this file in PostgreSQL's space
# of advisory locks, which all programs share.
LOCK_KEY, LOCK_SECONDS = 0x64617368, 120
TABLES = "SELECT to_regclass('experiments') IS NOT NULL"


def check_database(root: str) -> None:
    """Check that the database accepts this user.

    Raises:
        InputError: psycopg is not installed, the server does not respond, or it refuses the user,
            the password or the name of the database.
    """
    with _connection(root):
        pass


@contextmanager
def opening(root: str, artifacts: str | None) -> Iterator[MlflowClient]:
    """Open the database for one process at a time; yield its client.

    MLflow creates the tables of a new database without a lock.

    Args:
        root: address of the database.
        artifacts: bucket in which MLflow's own default experiment keeps its artifacts.

    Raises:
        InputError: as :func:`check_database`, or another process has been opening the database for
            minutes.
    """
    uri = mlflow_uri(root)
    with _connection(root) as connection:
        _lock(connection, root)
        if artifacts is not None and not connection.execute(TABLES).fetchone()[0]:
            from mlflow.store.tracking.sqlalchemy_store import SqlAlchemyStore

            SqlAlchemyStore(uri, artifacts)
        from mlflow import MlflowClient

        yield MlflowClient(tracking_uri=uri)


def mlflow_uri(root: str) -> str:
    """Return the address of a database for MLflow: with the driver, and with limits of time."""
    parts = urlsplit(root)
    query = LIMITS | dict(parse_qsl(parts.query))
    return urlunsplit(parts._replace(scheme=DRIVER, query=urlencode(query)))


@contextmanager
def _connection(root: str) -> Iterator[Any]:
    """Connect for the length of a block."""
    try:
        import psycopg
    except ImportError:
        raise not_installed("psycopg", "a PostgreSQL database", root) from None
    address = mlflow_uri(root).replace(DRIVER, DATABASE, 1)
    try:
        connection = psycopg.connect(address)
    except psycopg.OperationalError as error:
        raise _refusal(error, root) from None
    except psycopg.Error as error:
        what = f"this is not the address of a database: {first_line(error)}"
        raise InputError(what, where=root) from None
    with connection:
        yield connection


def _refusal(error: Exception, root: str) -> InputError:
    text = first_line(error)
    # libpq: "connection to server at HOST, port N failed: FATAL:  password authentication failed"
    _, refused, reason = text.partition("FATAL:  ")
    if "no password supplied" in text:
        refused, reason = "refused", "it asks for a password"
    if not refused:
        hint = "start the server, or correct the address in tracking.root"
        return StoreUnreachableError(
            f"no PostgreSQL server responds: {text}", where=root, hint=hint
        )
    # A server that is starting or has no connection left says so in the same words each time.
    busy = ("starting up", "shutting down", "too many", "connection slots")
    if any(sign in reason for sign in busy):
        return StoreUnreachableError(f"the PostgreSQL server is not ready: {reason}", where=root)
    hint = "user and database are in the address; the password is in PGPASSWORD or ~/.pgpass"
    return InputError(f"the PostgreSQL server refuses: {reason}", where=root, hint=hint)


def _lock(connection: Any, root: str) -> None:
    """Hold a lock until the connection ends."""
    import psycopg

    try:
        connection.execute(f"SET LOCAL lock_timeout = '{LOCK_SECONDS}s'")
        connection.execute("SELECT pg_advisory_xact_lock(%s)", (LOCK_KEY,))
    except psycopg.errors.LockNotAvailable:
        what = f"another process has been opening this store for more than {LOCK_SECONDS} s"
        raise InputError(what, where=root, hint="end that process, then try again") from None
