"""The bucket of an S3-compatible server that holds the artifacts of runs.

MLflow sends the artifacts. The address and the access key are in the environment variables that it
reads: ``MLFLOW_S3_ENDPOINT_URL``, ``AWS_ACCESS_KEY_ID`` and ``AWS_SECRET_ACCESS_KEY``.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from dashred.core.errors import InputError
from dashred.core.mlflow.connection_errors import (
    StoreUnreachableError,
    first_line,
    is_outage,
    not_installed,
)

if TYPE_CHECKING:
    from botocore.exceptions import ClientError

# By default boto3 waits a minute for each of five attempts.
os.environ.setdefault("AWS_RETRY_MODE", "standard")
os.environ.setdefault("AWS_MAX_ATTEMPTS", "3")

ENDPOINT = "MLFLOW_S3_ENDPOINT_URL"
CONNECT_SECONDS, ANSWER_SECONDS, ATTEMPTS = 5, 5, 2
KEYS = "set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"
# Of the object that a check begins to write. It is never stored.
PROBE = ".dashred-check"
TRUE = ("true", "1")


def is_bucket(location: str) -> bool:
    """Return whether artifacts are kept in a bucket, to which this process sends them."""
    return location.startswith("s3://")


def check_bucket(location: str) -> None:
    """Check that artifacts can be written to a bucket; nothing is stored.

    Args:
        location: address of the bucket or of a folder in it, ``s3://BUCKET/FOLDER``.

    Raises:
        InputError: boto3 is not installed, the server does not respond, it refuses the access key,
            or there is no such bucket.
    """
    try:
        from botocore.exceptions import (
            BotoCoreError,
            ClientError,
            NoCredentialsError,
            ParamValidationError,
        )
    except ImportError:
        raise not_installed("boto3", "a bucket of artifacts", location) from None
    bucket, folder = urlsplit(location).netloc, urlsplit(location).path.strip("/")
    key = f"{folder}/{PROBE}".lstrip("/")
    try:
        client = _client()
        # Beginning an upload needs the right to write, and leaves nothing once it is aborted.
        begun = client.create_multipart_upload(Bucket=bucket, Key=key)
        client.abort_multipart_upload(Bucket=bucket, Key=key, UploadId=begun["UploadId"])
    except NoCredentialsError:
        raise InputError("no access key is given", where=location, hint=KEYS) from None
    except ParamValidationError:
        raise InputError("no bucket can have this name", where=location) from None
    except ClientError as error:
        raise _refusal(error, bucket, location) from None
    except (BotoCoreError, ValueError) as error:
        kind = StoreUnreachableError if is_outage(error) else InputError
        what = f"no S3 server responds: {first_line(error)}"
        hint = f"start the server, or set {ENDPOINT} to its address: http://HOST:PORT"
        raise kind(what, where=location, hint=hint) from None


def _client() -> Any:
    import boto3
    from botocore.config import Config

    unverified = os.environ.get("MLFLOW_S3_IGNORE_TLS", "").lower() in TRUE
    return boto3.client(
        "s3",
        endpoint_url=os.environ.get(ENDPOINT) or None,
        verify=False if unverified else None,
        config=Config(
            signature_version="s3v4",
            connect_timeout=CONNECT_SECONDS,
            read_timeout=ANSWER_SECONDS,
            retries={"total_max_attempts": ATTEMPTS, "mode": "standard"},
            s3={"addressing_style": os.environ.get("MLFLOW_BOTO_CLIENT_ADDRESSING_STYLE", "auto")},
        ),
    )


def _refusal(error: ClientError, bucket: str, location: str) -> InputError:
    code = str(error.response.get("Error", {}).get("Code", ""))
    if is_outage(error):
        return StoreUnreachableError(f"the S3 server is not ready: {code}", where=location)
    if code == "NoSuchBucket":
        hint = f"create it, or choose another with tracking.artifacts; {ENDPOINT} names the server"
        return InputError(f"there is no bucket {bucket}", where=location, hint=hint)
    what = f"the S3 server refuses to write there: {code}"
    return InputError(what, where=location, hint=f"{KEYS} of a user who may write to this bucket")
