"""Open the program of a system."""

from __future__ import annotations

import re
from collections.abc import Callable

from dashred.physics.external.adapter import Adapter
from dashred.physics.external.adapters.command.command import CommandWords, open_command
from dashred.physics.external.adapters.command.layout import Layout
from dashred.physics.external.adapters.command.on_cluster import ClusterCommandAdapter
from dashred.physics.external.adapters.fmu.description import Description, read_description
from dashred.physics.external.adapters.fmu.fmu import FmuAdapter
from dashred.physics.external.adapters.fmu.fmu_tangents import FmuTangents
from dashred.physics.external.adapters.function import FunctionAdapter, open_function, open_run
from dashred.physics.external.partial import PartialProgram
from dashred.physics.external.protocol import Program, Stepper
from dashred.physics.external.stepped import SteppedProgram
from dashred.physics.external.stepped_fields import stepped_fields
from dashred.physics.external.tangents.checked_tangents import CheckedTangents
from dashred.physics.external.trust import check_trusted, names_of
from dashred.physics.grids.grid import Grid
from dashred.physics.grids.mesh import Mesh
from dashred.physics.system_schema import ExternalSimulator, System

_opened: dict[tuple[object, ...], Program] = {}


def open_program(config: System, where: Callable[[str], str], grid: Grid | Mesh) -> Program:
    """Return the program of a system; a process opens each program once.

    Args:
        config: of the system, with ``simulator``.
        where: location of a configuration key.
        grid: of the system.

    Raises:
        InputError: the program is not trusted, or cannot be opened.
    """
    simulator = config.simulator
    assert simulator is not None
    [(key, name)] = names_of(simulator).items()
    place = where(f"system.simulator.{key}")
    check_trusted(name, place)
    known = repr(simulator), tuple(config.fields), repr(config.units), grid, place
    if known not in _opened:
        own = stepped_fields(config)
        adapter = _adapter(config, own, key, grid, place)
        program = SteppedProgram(adapter, grid, simulator.keep)
        program.tangent = _offered_tangents(adapter, program, grid, simulator)
        places = [i for i, field in enumerate(config.fields) if field in own]
        whole = len(places) == len(config.fields)
        _opened[known] = program if whole else PartialProgram(program, places, len(config.fields))
    return _opened[known]


def _offered_tangents(
    adapter: Adapter, program: Program, grid: Grid | Mesh, simulator: ExternalSimulator
) -> Stepper | None:
    if isinstance(adapter, FmuAdapter) and adapter.offers_derivatives:
        return SteppedProgram(FmuTangents(adapter), grid, simulator.keep)
    if not isinstance(adapter, FunctionAdapter) or simulator.function is None:
        return None
    offered = adapter.with_tangents()
    if offered is None:
        return None
    tangent = SteppedProgram(offered, grid, simulator.keep)
    return CheckedTangents(tangent, program, offered.name, adapter.place)


def _adapter(
    config: System, fields: tuple[str, ...], key: str, grid: Grid | Mesh, place: str
) -> Adapter:
    simulator = config.simulator
    assert simulator is not None
    limit = simulator.time_limit
    if simulator.command is not None:
        coordinates = {name: (along, x.numpy()) for name, (along, x) in grid.labels.items()}
        layout = Layout(fields, grid.dimensions, coordinates, config.units)
        words = CommandWords(tuple(simulator.command), simulator.template, limit, layout, place)
        return ClusterCommandAdapter(words, open_command(words))
    if simulator.fmu is not None:
        return FmuAdapter(describe_fmu(config, place), fields, place)
    if simulator.function is not None:
        return open_function(simulator.function, fields, place, limit)
    assert simulator.run is not None
    return open_run(simulator.run, fields, place, limit)


def describe_fmu(config: System, place: str) -> Description:
    """Return the description of a system's FMU.

    It must have all parameters and inputs, but those that the equations beside it read. Of these it
    gets the ones that it has.

    Args:
        config: of the system, with ``simulator.fmu``.
        place: location of this key.

    Raises:
        InputError: see :func:`.adapters.fmu.description.read_description`.
    """
    simulator = config.simulator
    assert simulator is not None and simulator.fmu is not None
    texts = " ".join(repr(part) for part in (config.equations, config.let, config.energy))
    own = set(re.findall(r"[A-Za-z]\w*", texts)) - simulator.variables.keys()
    names = (*config.parameters, *config.inputs)
    return read_description(
        simulator.fmu,
        stepped_fields(config),
        [name for name in names if name not in own],
        simulator.variables,
        simulator.interface,
        place,
        [name for name in names if name in own],
    )
