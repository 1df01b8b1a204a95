"""Validated, typed configuration from YAML files and command-line overrides.

:mod:`dashred.config.schema.settings` defines all keys, and ``conf/base.yaml`` their defaults. This
package does not import torch, so that input errors are reported at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dashred.config.bundled_systems import BASE, bundled, results_root
from dashred.config.checks.checks import check
from dashred.config.checks.expressions import check_expressions
from dashred.config.checks.system_units import collect_units
from dashred.config.commandline import (
    check_overrides,
    check_places,
    find_system,
    split_words,
    usage,
)
from dashred.config.frozen import config_sha256, frozen_input
from dashred.config.layers import merge, prepare, where_in
from dashred.config.python_class import check_trust, split_trust, trace_class
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
    "bundled",
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
        name: stem of the system's file, for example ``rde``.
        source: path of the system's file.
        lines: ``FILE:LINE`` or ``command line`` of each dotted key.
    """

    name: str
    source: Path
    lines: dict[str, str]

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
    words, trusted = split_trust(argv)
    word, overrides = split_words(words, entry=entry)
    path, label = find_system(word)
    defaults = prepare(read_file(BASE, label="conf/base.yaml"), folder=results_root())
    system = prepare(read_file(path, label=label), folder=path.resolve().parent)
    check_places(system)
    overrides = prepare(overrides, folder=Path.cwd())
    check_overrides(overrides, system)
    lines = defaults.lines | system.lines | overrides.lines | {"": label}
    settings = merge(defaults, system, overrides)
    collect_units(settings.system, lines)
    where = where_in(lines)
    check_trust(settings, trusted, where)
    if settings.system.class_ is not None:
        settings.system = trace_class(settings, where)
    check(settings, where)
    check_expressions(settings, where)
    return Config(**vars(settings), name=path.stem, source=path.resolve(), lines=lines)
