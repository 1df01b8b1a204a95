"""Checks of the section ``tracking`` against itself."""

from __future__ import annotations

from dashred.config.schema.settings import Tracking
from dashred.config.schema.types import Where
from dashred.core.errors import InputError
from dashred.core.mlflow.store_address import is_database, is_server


def check_tracking(tracking: Tracking, where: Where) -> None:
    """Check that the artifacts of a new run in a database have a bucket, and those of no other.

    Raises:
        InputError: the bucket is missing, or is not used.
    """
    # A run that exists has a place for its artifacts.
    if is_database(tracking.root) and tracking.artifacts is None and tracking.run is None:
        raise InputError(
            "a database does not hold the artifacts",
            where=where("tracking.root"),
            hint="give a bucket: tracking.artifacts=s3://BUCKET/FOLDER",
        )
    if tracking.artifacts is None or is_database(tracking.root):
        return
    place = "the server chooses" if is_server(tracking.root) else "they lie in the same folder"
    raise InputError(
        f"tracking.artifacts is not used: {place}",
        where=where("tracking.artifacts"),
        hint="leave it out, or give a database: tracking.root=postgresql://USER@HOST/DATABASE",
    )
