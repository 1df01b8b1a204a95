"""Validated, typed configuration from YAML files and command-line overrides.

:mod:`dashred.config.schema.settings` defines all keys, and ``conf/base.yaml`` their defaults. This
package does not import torch, so that input errors are reported at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dashred.config.bundled_systems import BASE, bundled_names, results_root
from dashred.config.checks.checks import check, check_recorded
from dashred.config.checks.expressions import check_expressions
from dashred.config.checks.system_units import collect_units
from dashred.config.commandline import (
    check_overrides,
    check_private_keys,
    find_system,
    parse_arguments,
    usage,
)
from dashred.config.frozen import config_sha256, frozen_input
from dashred.config.layers import merge, prepare, where_in
from dashred.config.parameter_spreads import write_out_spreads
from dashred.config.python_class import trace_class
from dashred.config.removals import remove_entries
from dashred.config.schema.recording import Recording, SensorSplit, Splits, TimeSplit
from dashred.config.schema.settings import (
    Assimilation,
    LatentSindy,
    Settings,
    Shred,
    Simulation,
    Tracking,
)
from dashred.config.source import Source, read_file
from dashred.config.trust import check_trust, split_trust
from dashred.core.command_line.arguments import COMMAND_LINE
from dashred.physics.system_schema import Axis, Integrator, System

__all__ = [
    "Assimilation",
    "Axis",
    "Config",
    "Integrator",
    "LatentSindy",
    "Recording",
    "SensorSplit",
    "Settings",
    "Shred",
    "Simulation",
    "Source",
    "Splits",
    "System",
    "TimeSplit",
    "Tracking",
    "build_config",
    "bundled_names",
    "config_sha256",
    "frozen_input",
    "load_config",
    "read_file",
    "usage",
]


@dataclass
class Config(Settings):
    """The settings of one run, and the location of each.

    Attributes:
        name: stem of the system's file, ``rde``.
        source: the system's file; None for a system that was given as a dict.
        lines: ``FILE:LINE`` or ``command line`` of each dotted key.
        written: the values of the system's file, or dict, as they were written; spreads of
            parameters are in ``parameter_spread``.
        override_place: what ``lines`` has of a key that was overridden: ``command line``.
    """

    name: str
    source: Path | None
    lines: dict[str, str]
    written: dict[str, Any]
    override_place: str = COMMAND_LINE

    def where(self, key: str) -> str:
        """Return the location of a dotted key or of its section: ``conf/rde.yaml:12``."""
        return where_in(self.lines)(key)


def load_config(argv: list[str], *, entry: str) -> Config:
    """Read ``conf=SYSTEM key=value ...`` into a checked configuration.

    The system's file overrides ``conf/base.yaml``, and the command line overrides both. ``--help``
    prints the usage of ``entry`` and exits with 0.

    Raises:
        InputError: the arguments or the files are invalid.
    """
    if {"--help", "-h"} & set(argv):
        print(usage(entry))
        raise SystemExit(0)
    arguments, trusted = split_trust(argv)
    system, overrides = parse_arguments(arguments, entry=entry)
    path, label = find_system(system)
    written, source = read_file(path, label=label), path.resolve()
    config = build_config(written, overrides, name=path.stem, source=source, trust=trusted)
    check_recorded(config, config.where)
    return config


def build_config(
    written: Source,
    overrides: Source,
    *,
    name: str,
    source: Path | None = None,
    trust: str | None = None,
) -> Config:
    """Lay the defaults, a system and overrides over each other, and check the result.

    Args:
        written: the system, as it is written.
        overrides: what lies over it; its place is that of the key ``""``.
        name: of the system.
        source: its file, from whose folder its paths count; None counts from the working folder.
        trust: name of the class, function, FMU or command whose code may run.

    Raises:
        InputError: anything wrong in the values. That there is no recording is not checked.
    """
    written, overrides = remove_entries(write_out_spreads(written), overrides)
    defaults = prepare(read_file(BASE, label="conf/base.yaml"), folder=results_root())
    folder = source.parent if source else Path.cwd()
    system = prepare(written, folder=folder)
    check_private_keys(system)
    overrides = prepare(overrides, folder=Path.cwd())
    check_overrides(overrides, system)
    lines = defaults.lines | system.lines | overrides.lines | {"": written.lines[""]}
    settings = merge(defaults, system, overrides)
    collect_units(settings.system, lines)
    where = where_in(lines)
    check_trust(settings, trust, where, folder)
    if settings.system.class_ is not None:
        settings.system = trace_class(settings, where)
    check(settings, where)
    check_expressions(settings, where)
    return Config(
        **vars(settings),
        name=name,
        source=source,
        lines=lines,
        written=written.values,
        override_place=overrides.lines[""],
    )
