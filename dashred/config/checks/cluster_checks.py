"""Checks of the word ``cluster``: what it names, and whether workers have anything to compute."""

from __future__ import annotations

from dashred.config.schema.settings import Settings
from dashred.config.schema.types import Where
from dashred.core.cluster.word import EXAMPLES, read_cluster
from dashred.core.errors import InputError
from dashred.physics.boundaries.entries import one_sided_axis
from dashred.physics.system_schema import System


def check_cluster(settings: Settings, where: Where) -> None:
    """Check the cluster of an analysis, if there is one.

    Raises:
        InputError: the text names no cluster, or no part of the analysis runs on workers.
    """
    if settings.cluster is None:
        return
    try:
        read_cluster(settings.cluster)
    except ValueError as error:
        raise InputError(str(error), where=where("cluster"), hint=f"cluster={EXAMPLES}") from None
    if not (_has_command(settings.system) or _has_spectral_fields(settings.system)):
        raise InputError(
            "no part of this analysis runs on a cluster: its system has neither a "
            "simulator.command nor equations of spectral fields",
            where=where("cluster"),
            hint="leave it out: the analysis runs in threads=",
        )
    if settings.device != "cpu" and not _has_command(settings.system):
        raise InputError(
            "the workers of a cluster compute on CPUs",
            where=where("cluster"),
            hint=f"leave out cluster, or device={settings.device}",
        )


def _has_command(system: System) -> bool:
    return system.simulator is not None and system.simulator.command is not None


def _has_spectral_fields(system: System) -> bool:
    is_grid = bool(system.axes) and system.nodes is None and one_sided_axis(system) is None
    is_given = system.simulator is None and system.snapshots is None
    return is_grid and is_given and system.integrator.space == "spectral"
