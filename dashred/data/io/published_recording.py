"""A recording that others have published: where it lies, what it is, whether it is the right one.

The file that the authors publish is MATLAB's; what is kept is a CSV, and the hash is the CSV's.
"""

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
LARGEST = 64 * 2**20
SILENCE, PATIENCE = 20.0, 180.0  # seconds without a byte, and in all
PIECES = (("Time_id", "Y_id"), ("Time_vad", "Y_vad"))


@dataclass(frozen=True)
class Published:
    """One published recording.

    Attributes:
        repository: ``OWNER/NAME`` on GitHub.
        commit: of it, so that what is fetched cannot change.
        file: its path there.
        sha256: of the CSV that is made of it.
        contents: what the CSV holds, with units.
        citation: who recorded it.
        licence: under which it may be used, and whose it is.
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
        """Where it is fetched from."""
        path = quote(f"{self.repository}/{self.commit}/{self.file}")
        return f"https://raw.githubusercontent.com/{path}"


PENDULUM = Published(
    repository="dynamicslab/MultiArm-Pendulum",
    commit="78ed9353702f1f9e92c74d3bb671a7804fb41fb0",
    file="ParameterEstimation/SinglePendulum/SinglePendulumDataForParameterEstimation.mat",
    sha256="f2aa178bae9fa03ef93ea521edab0935dba0c2b4986114887a2029dbfa32a4b4",
    contents="55,001 rows at 1 kHz of time (s), theta (rad from hanging) and omega (rad/s)",
    citation="Kaheman, Fasel, Bramburger, Strom, Kutz, Brunton: The Experimental Multi-Arm "
    "Pendulum on a Cart (2022)",
    licence="MIT, © 2022 dynamicslab (LICENSE in github.com/dynamicslab/MultiArm-Pendulum)",
)


def fetched(recording: Published, source: str) -> str:
    """Return the recording's CSV from a URL, or from a file that the user has downloaded.

    Raises:
        InputError: it cannot be had, or what came is not this recording.
    """
    raw = _download(source) if "://" in source else _read(source)
    text = _csv(raw, source) if raw.startswith(MATLAB) else raw
    if hashlib.sha256(text).hexdigest() != recording.sha256:
        raise InputError(
            f"what came ({len(raw)} bytes) is not the recording, or was cut short: "
            "its hash is another",
            where=source,
            hint=f"nothing was written; the CSV's sha256 should be {recording.sha256}",
        )
    return text.decode()


def _read(path: str) -> bytes:
    try:
        return user_path(path, "source=").read_bytes()
    except OSError as error:
        raise InputError(f"cannot read the file: {error.strerror}", where=path) from None


def _download(url: str) -> bytes:
    if urlsplit(url).scheme not in ("http", "https"):
        raise InputError("only http and https are fetched from", where=url)
    try:
        return _body(url)
    except HTTPError as error:
        what = f"the server answered {error.code} {error.reason}"
    except URLError as error:
        what = f"cannot be reached: {error.reason}"
    except TimeoutError:
        what = "the server does not go on answering"
    except (HTTPException, OSError, ValueError) as error:
        what = f"cannot be fetched: {error or type(error).__name__}"
    hint = "is there a network? a file that you have downloaded is taken by source=FILE"
    raise InputError(f"{what}; nothing was written", where=url, hint=hint) from None


def _body(url: str) -> bytes:
    """Return what a URL holds: not more than is sensible, not for longer than is bearable."""
    until = time.monotonic() + PATIENCE
    body = bytearray()
    with urlopen(Request(url, headers={"User-Agent": "dashred"}), timeout=SILENCE) as response:
        while piece := response.read1(2**16):
            body += piece
            if len(body) > LARGEST:
                raise ValueError(f"more than {LARGEST // 2**20} MiB")
            if time.monotonic() > until:
                raise TimeoutError
    return bytes(body)


def _csv(raw: bytes, source: str) -> bytes:
    """Return a CSV of the authors' MATLAB file: six consecutive pieces, in two lists.

    Their ``PrepareDataForSinglePendulumParameterEstimation.m`` cut them: angle and velocity in
    the rows of ``Y_*``, times in ``Time_*``. The angle is theirs less π: from hanging.
    """
    # Imported late: help and every wrong word are answered without it.
    import numpy as np
    from scipy.io import loadmat

    file: Any = io.BytesIO(raw)  # scipy's stubs know of paths alone
    try:
        held: dict[str, Any] = loadmat(file)
        pieces = [
            np.column_stack([np.ravel(times), np.transpose(state)])
            for clock, states in PIECES
            for times, state in zip(held[clock].flat, held[states].flat, strict=True)
        ]
        rows = np.concatenate(pieces).astype(float)
        lines = [f"{t:.3f},{angle - math.pi:.6f},{speed:.6f}" for t, angle, speed in rows]
    # A broken file makes scipy raise nearly anything.
    except Exception as error:
        what = f"not the authors' MATLAB file: {type(error).__name__}"
        raise InputError(what, where=source, hint="nothing was written") from None
    return "\n".join(["time,theta,omega", *lines, ""]).encode()
