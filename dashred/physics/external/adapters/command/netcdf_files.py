"""States in NetCDF, for a command that steps a batch of them.

The input has the dimensions ``member`` and the axes, a variable ``(member, *axes)`` for each field,
``(member)`` for t, dt and each input, and the parameters as attributes of the file. The output has
the fields, with the same dimensions, at ``t + dt``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.core.units import check_same_unit, check_unit
from dashred.physics.external.adapters.command.layout import Layout
from dashred.physics.external.state_batch import Array, ProgramError, StateBatch, read_fields

# Names of the file's own dimension and variables, which no field and no input can have.
OWN_NAMES = ("member", "t", "dt")
# Number of earlier files that are held.
MOST_FILES = 8


class InputWriter:
    """Writes inputs. A copy of an earlier file that is filled in takes a tenth of a new one."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        # A file by number of states.
        self._files: dict[int, bytes] = {}

    def write(self, path: Path, batch: StateBatch) -> None:
        """Write the states of a batch ``(batch, field, *grid)``, with t, dt and inputs."""
        import h5py  # type: ignore[import-untyped]

        earlier = self._files.get(len(batch))
        if earlier is None:
            self._write_new(path, batch)
            if len(self._files) == MOST_FILES:
                self._files.clear()
            self._files[len(batch)] = path.read_bytes()
            return
        path.write_bytes(earlier)
        with h5py.File(path, "r+") as file:
            for index, name in enumerate(self._layout.fields):
                file[name][...] = batch.states[:, index]
            for name, values in _clocks(batch).items():
                file[name][...] = values
            for name, value in batch.parameters.items():
                file.attrs[name] = float(value)

    def _write_new(self, path: Path, batch: StateBatch) -> None:
        import xarray as xr

        layout = self._layout
        dims = ("member", *layout.dimensions)
        variables = {
            name: (dims, batch.states[:, index], _units(name, layout))
            for index, name in enumerate(layout.fields)
        }
        for name, values in _clocks(batch).items():
            variables[name] = (("member",), values, _units("t" if name == "dt" else name, layout))
        coords = {
            name: ((dimension,), x, _units(name, layout))
            for name, (dimension, x) in layout.coordinates.items()
        }
        attributes = {name: float(value) for name, value in batch.parameters.items()}
        xr.Dataset(variables, coords, attributes).to_netcdf(path, engine="h5netcdf")


def read_output(path: Path, members: int, layout: Layout) -> Array:
    """Return the states of an output, ``(member, field, *grid)``.

    Raises:
        ProgramError: the file cannot be read, or has not the fields over the dimensions.
        InputError: a unit differs from that of the system.
    """
    found = _read_variables(path, members, layout)
    values = read_fields(found, layout.fields, (members, *layout.shape))
    return np.moveaxis(values, 0, 1)


def _read_variables(path: Path, members: int, layout: Layout) -> dict[str, NDArray[np.generic]]:
    import xarray as xr

    found, wanted = {}, ("member", *layout.dimensions)
    try:
        # A classic file, which many programs in Fortran write, is read by SciPy.
        with path.open("rb") as file:
            engine = "scipy" if file.read(3) == b"CDF" else "h5netcdf"
        with xr.open_dataset(path, engine=engine, decode_times=False, chunks=None) as dataset:
            for name in layout.fields:
                if name not in dataset.data_vars:
                    continue
                variable = dataset[name]
                if members == 1 and "member" not in variable.dims:
                    variable = variable.expand_dims("member")
                if set(variable.dims) != set(wanted):
                    told = ", ".join(map(str, variable.dims))
                    raise ProgramError(f"writes {name} over ({told}), not ({', '.join(wanted)})")
                found[name] = variable.transpose(*wanted).values
                _check_unit(name, str(variable.attrs.get("units", "")), layout)
    except (ProgramError, InputError):
        raise
    except Exception as error:  # HDF5 raises many kinds of errors for half a file
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ProgramError(f"writes an output that cannot be read: {reason}") from error
    return found


def _clocks(batch: StateBatch) -> dict[str, Array]:
    return {"t": batch.t, "dt": batch.dt, **batch.inputs}


def _units(name: str, layout: Layout) -> dict[str, str]:
    return {"units": layout.units[name]} if name in layout.units else {}


def _check_unit(name: str, text: str, layout: Layout) -> None:
    if text.strip():
        where = f"output of system.simulator.command, {name!r}"
        unit = check_unit(text, name, where)
        check_same_unit(name, unit, where, layout.units.get(name), f"system.units.{name}")
