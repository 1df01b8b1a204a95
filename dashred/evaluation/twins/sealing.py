"""The hidden truth of a twin experiment and the sealed file that stores it.

Only the recorder writes the file and only the scorer reads it. tests/test_seal.py checks that
nothing else imports this module.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
import xarray as xr
from torch import Tensor

from dashred.core.errors import InputError
from dashred.core.files.atomic import write_netcdf_atomic
from dashred.physics.system import System


@dataclass(frozen=True)
class SealedTerm:
    """One term of the hidden law, in the equation language.

    Attributes:
        equation: the field whose tendency it adds to.
        term: the expression.
        coefficient: its coefficient.
        window: ``(of, from, to, edge)`` along an axis, in ``t`` or in the value of a field; a
            bound may be None. None if the term acts everywhere.
    """

    equation: str
    term: str
    coefficient: float
    window: tuple[str, float | None, float | None, float] | None = None


@dataclass(frozen=True)
class SealedFault:
    """A hidden sensor fault.

    Attributes:
        sensor: its name.
        kind: a key of :data:`dashred.core.findings.fault_kinds.FAULT_KINDS`.
        value: the bias, the drift per unit time, the size of a spike or of a wandering, the
            displacement, or the time from which a stuck sensor repeats its value.
    """

    sensor: str
    kind: str
    value: float


@dataclass(frozen=True)
class Concealed:
    """Hidden causes other than missing terms. The names of the attributes determine random streams.

    Attributes:
        parameters: true values of the misstated parameters, by name.
        faults: sensor faults.
        spread: spread of the initial state over that of its prior.
        correlation: correlation of the noise between consecutive samples.
    """

    parameters: dict[str, float] = field(default_factory=dict)
    faults: tuple[SealedFault, ...] = ()
    spread: float = 1.0
    correlation: float = 0.0


@dataclass(frozen=True)
class Truth:
    """The hidden truth of one twin.

    Attributes:
        twin: its name.
        terms: the law that the simulator lacks.
        times: ``(time,)``; extends past the end of the recording, for forecasts.
        duration: length of the recording.
        states: ``(time, field, *grid)`` on the simulator's grid, without noise; mirror images
            beyond boundaries are not stored on disk.
        concealed: other hidden causes.
    """

    twin: str
    terms: tuple[SealedTerm, ...]
    times: Tensor
    duration: float
    states: Tensor
    concealed: Concealed = Concealed()


def seal(path: Path, truth: Truth, system: System) -> None:
    """Write the truth atomically."""
    axes = [axis.name for axis in system.axes]
    states = system.grid.own(truth.states).numpy()
    fields = {name: (("time", *axes), states[:, i]) for i, name in enumerate(system.fields)}
    terms = json.dumps([asdict(term) for term in truth.terms])
    concealed = json.dumps(asdict(truth.concealed))
    attributes = {"twin": truth.twin, "terms": terms, "duration": truth.duration}
    attributes["concealed"] = concealed
    dataset = xr.Dataset(fields, {"time": truth.times.numpy()}, attributes)
    write_netcdf_atomic(path, dataset)


def open_seal(path: Path) -> tuple[Truth, tuple[str, ...]]:
    """Read the truth and the names of its fields.

    Raises:
        InputError: the file does not exist or is not a sealed truth.
    """
    try:
        with xr.open_dataset(path, engine="h5netcdf") as dataset:
            fields = tuple(str(name) for name in dataset.data_vars)
            states = np.stack([dataset[name].values for name in fields], axis=1)
            terms = tuple(map(_term, json.loads(dataset.attrs["terms"])))
            truth = Truth(
                str(dataset.attrs["twin"]),
                terms,
                torch.tensor(dataset["time"].values),
                float(dataset.attrs["duration"]),
                torch.from_numpy(states),
                _concealed(json.loads(dataset.attrs["concealed"])),
            )
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise InputError(f"cannot open the sealed truth: {error}", where=str(path)) from None
    return truth, fields


def _term(plain: dict[str, Any]) -> SealedTerm:
    window = plain.pop("window")
    return SealedTerm(**plain, window=tuple(window) if window else None)


def _concealed(plain: dict[str, Any]) -> Concealed:
    faults = tuple(SealedFault(**fault) for fault in plain.pop("faults"))
    return Concealed(**plain, faults=faults)
