"""Where an MLflow store and its artifacts are: a folder, a server or a database, and a bucket."""

from __future__ import annotations

from typing import NamedTuple
from urllib.parse import SplitResult, parse_qsl, urlsplit

from dashred.core.errors import InputError

SERVERS = ("http", "https")
DATABASE = "postgresql"
STORE = (
    "give the folder that holds mlflow.db, the address of a server, http://HOST:5000, or of a "
    "database, postgresql://USER@HOST/DATABASE"
)
ARTIFACTS = "give the address of a bucket or of a folder in it: s3://BUCKET/FOLDER"
SERVER_PASSWORD = "log in with MLFLOW_TRACKING_USERNAME and MLFLOW_TRACKING_PASSWORD instead"
DATABASE_PASSWORD = "log in with PGPASSWORD or the file ~/.pgpass instead"
ACCESS_KEY = "log in with AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY instead"


class StorePlace(NamedTuple):
    """The store of a run.

    Attributes:
        root: ``tracking.root``: a folder, or the address of a server or of a database.
        experiment: name of the experiment.
        artifacts: ``tracking.artifacts``: the bucket of a database.
    """

    root: str
    experiment: str
    artifacts: str | None = None


def is_server(root: str) -> bool:
    """Return whether ``tracking.root`` is the address of a server or a database, not a folder."""
    scheme, separator, _ = root.partition("://")
    return bool(separator) and scheme in (*SERVERS, DATABASE)


def is_database(root: str) -> bool:
    """Return whether ``tracking.root`` is the address of a database."""
    return root.startswith(f"{DATABASE}://")


def check_address(root: str, where: str) -> None:
    """Check that an address in ``tracking.root`` is that of a server or of a database.

    Raises:
        InputError: it is not, or it contains a password: addresses are printed and stored.
    """
    if "://" not in root and not root.startswith("sqlite:"):
        return
    if not is_server(root):
        what = "this is neither a folder nor a server nor a PostgreSQL database"
        raise InputError(what, where=where, hint=STORE)
    address = _split(root)
    if is_database(root):
        if address is None or not address.path.strip("/"):
            raise InputError("this is not the address of a database", where=where, hint=STORE)
        secret, hint = address.password is not None, DATABASE_PASSWORD
        secret |= any("password" in key for key, _ in parse_qsl(address.query, True))
    else:
        if address is None or not address.hostname:
            raise InputError("this is not the address of a server", where=where, hint=STORE)
        secret, hint = "@" in address.netloc, SERVER_PASSWORD
    if secret:
        what = f"the address of a {'database' if is_database(root) else 'server'}"
        raise InputError(f"{what} must not contain a password", where=where, hint=hint)


def artifacts_address(text: str, where: str) -> str:
    """Return the address of a bucket, or of a folder in it, without a slash at its end.

    Raises:
        InputError: it is not the address of a bucket, or it contains an access key.
    """
    address = _split(text)
    if address is None or address.scheme != "s3" or not address.netloc:
        raise InputError("this is not the address of a bucket", where=where, hint=ARTIFACTS)
    if "@" in address.netloc:
        what = "the address of a bucket must not contain an access key"
        raise InputError(what, where=where, hint=ACCESS_KEY)
    if address.query or address.fragment:
        raise InputError("the name of a folder has no ? or #", where=where, hint=ARTIFACTS)
    return text.rstrip("/")


def _split(address: str) -> SplitResult | None:
    """Return the parts of an address; None if it is malformed or its port is none."""
    try:
        parts = urlsplit(address)
        return None if parts.port == 0 else parts
    except ValueError:
        return None
