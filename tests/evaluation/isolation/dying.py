"""A stand-in for the analysis, for the processes of a cluster."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from dashred.evaluation.isolation.analysis import Analysis, Answer


def die_once(analysis: Analysis) -> Answer:
    """Kill the worker of the first try; tell the process of the second."""
    marker = Path(analysis.words[0])
    if not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return Answer(1.0, 1.0, None, b"", {"process": str(os.getpid()).encode()})


def die_always(analysis: Analysis) -> Answer:
    """Kill the worker."""
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError
