"""Download of a published recording, converted from MATLAB to CSV and verified by its hash."""

from __future__ import annotations

import hashlib
import io
import math
import time
from dataclasses import dataclass
from http.client import HTTPException
from typing import Any
from urllib.error import HTTPError, URLError
from urllib.parse import quote, urlsplit
from urllib.request import Request, urlopen

from dashred.core.errors import InputError
from dashred.core.files.user_path import user_path

MATLAB = b"MATLAB 5.0 MAT-file"
MAX_BYTES = 64 * 2**20
READ_TIMEOUT, TOTAL_TIMEOUT = 20.0, 180.0  # seconds without a byte, and in all
PIECES = (("Time_id", "Y_id"), ("Time_vad", "Y_vad"))


@dataclass(frozen=True)
class PublishedRecording:
    """One published recording.

    Attributes:
        repository: ``OWNER/NAME`` on GitHub.
        commit: of the repository, so that the download cannot change.
        file: path in the repository.
        sha256: hash of the converted CSV.
        contents: columns of the CSV, with units.
        citation: authors and title.
        licence: name and holder of the licence.
    """

    repository: str
    commit: str
    file: str
    sha256: str
    contents: str
    citation: str
    licence: str

    @property
    def url(self) -> str:
        """URL of the file."""
        path = quote(f"{self.repository}/{self.commit}/{self.file}")
        return f"https://raw.githubusercontent.com/{path}"


PENDULUM = PublishedRecording(
    repository="dynamicslab/MultiArm-Pendulum",
    commit="78ed9353702f1f9e92c74d3bb671a7804fb41fb0",
    file="ParameterEstimation/SinglePendulum/SinglePendulumDataForParameterEstimation.mat",
    sha256="f2aa178bae9fa03ef93ea521edab0935dba0c2b4986114887a2029dbfa32a4b4",
    contents="55,001 rows at 1 kHz of time (s), theta (rad from hanging) and omega (rad/s)",
    citation="Kaheman, Fasel, Bramburger, Strom, Kutz, Brunton: The Experimental Multi-Arm "
    "Pendulum on a Cart (2022)",
    licence="MIT, © 2022 dynamicslab (LICENSE in github.com/dynamicslab/MultiArm-Pendulum)",
)


def fetch_csv(recording: PublishedRecording, source: str) -> str:
    """Return the recording as CSV text, from a URL or from a file that the user has downloaded.

    Raises:
        InputError: the source cannot be read, or is not this recording.
    """
    raw = _download(source) if "://" in source else _read(source)
    text = _csv(raw, source) if raw.startswith(MATLAB) else raw
    if hashlib.sha256(text).hexdigest() != recording.sha256:
        raise InputError(
            f"the {len(raw)} bytes received are not the recording, or were cut short: "
            "the hash does not match",
            where=source,
            hint=f"nothing was written; the sha256 of the CSV must be {recording.sha256}",
        )
    return text.decode()


def _read(path: str) -> bytes:
    try:
        return user_path(path, "source=").read_bytes()
    except OSError as error:
        raise InputError(f"cannot read the file: {error.strerror}", where=path) from None


def _download(url: str) -> bytes:
    if urlsplit(url).scheme not in ("http", "https"):
        raise InputError("only http and https URLs are supported", where=url)
    try:
        return _body(url)
    except HTTPError as error:
        what = f"the server answered {error.code} {error.reason}"
    except URLError as error:
        what = f"cannot be reached: {error.reason}"
    except TimeoutError:
        what = "the server stopped responding"
    except (HTTPException, OSError, ValueError) as error:
        what = f"cannot be downloaded: {error or type(error).__name__}"
    hint = "check the network, or give a file that you have downloaded with source=FILE"
    raise InputError(f"{what}; nothing was written", where=url, hint=hint) from None


def _body(url: str) -> bytes:
    """Return the contents of a URL, within limits on size and time."""
    until = time.monotonic() + TOTAL_TIMEOUT
    body = bytearray()
    with urlopen(Request(url, headers={"User-Agent": "dashred"}), timeout=READ_TIMEOUT) as response:
        while piece := response.read1(2**16):
            body += piece
            if len(body) > MAX_BYTES:
                raise ValueError(f"more than {MAX_BYTES // 2**20} MiB")
            if time.monotonic() > until:
                raise TimeoutError
    return bytes(body)


def _csv(raw: bytes, source: str) -> bytes:
    """Convert the authors' MATLAB file to CSV.

    The file holds six consecutive segments in two lists, cut by the authors'
    ``PrepareDataForSinglePendulumParameterEstimation.m``: angle and velocity in the rows of
    ``Y_*``, times in ``Time_*``. The authors' angle minus π is the angle from hanging.
    """
    # Imported here, so that --help and argument errors do not wait for scipy.
    import numpy as np
    from scipy.io import loadmat

    file: Any = io.BytesIO(raw)  # scipy's stubs accept paths only
    try:
        held: dict[str, Any] = loadmat(file)
        pieces = [
            np.column_stack([np.ravel(times), np.transpose(state)])
            for clock, states in PIECES
            for times, state in zip(held[clock].flat, held[states].flat, strict=True)
        ]
        rows = np.concatenate(pieces).astype(float)
        lines = [f"{t:.3f},{angle - math.pi:.6f},{speed:.6f}" for t, angle, speed in rows]
    # scipy may raise almost any exception for a damaged file.
    except Exception as error:
        what = f"not the authors' MATLAB file: {type(error).__name__}"
        raise InputError(what, where=source, hint="nothing was written") from None
    return "\n".join(["time,theta,omega", *lines, ""]).encode()
