"""Check a configuration before a run: ``dashred check conf=my.yaml``.

Reads what a run would read, never a twin's truth, and writes nothing. The exit code is 0 if a run
can start, with or without warnings, and 2 if the input is wrong or incomplete.
"""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING

from dashred.config import Config, load_config
from dashred.config.checks.placeholders import unfinished_lines
from dashred.core.errors import DONE, WRONG_INPUT
from dashred.pipeline.check.page import Page

if TYPE_CHECKING:
    from dashred.data.episodes import Episodes


def main(argv: list[str]) -> int:
    """Load and check the configuration; return the exit code."""
    config = load_config(argv, entry="check")
    page = Page()
    show_unfinished_lines(config, page)
    _check_places(config)
    check(config, page)
    return WRONG_INPUT if page.has_errors or unfinished_lines(config) else DONE


def show_unfinished_lines(config: Config, page: Page) -> None:
    """Show the title of the system and the unfinished lines of its configuration."""
    from dashred.pipeline.check.placeholders import placeholder_remarks

    page.title(f"{config.system.title}: {config.where('')}")
    page.section("Left to do", placeholder_remarks(config))


def _check_places(config: Config) -> None:
    """Refuse a device, an output folder or a store that a run could not use."""
    from dashred.core.mlflow.store_check import check_store
    from dashred.models.device import check_device
    from dashred.pipeline.run.output_dir import check_output

    check_device(config)
    check_output(config)
    check_store(config.tracking.root, config.tracking.artifacts)


def check(config: Config, page: Page, recorded: Episodes | None = None) -> None:
    """Show the remarks on a configuration, section by section.

    Args:
        config: the configuration.
        page: page that shows the remarks.
        recorded: the recording; None to read the one named by ``recording.path``, if any.

    Raises:
        InputError: a run would refuse the configuration.
    """
    # Imported late: torch takes a second to import, and the first section does not need it.
    import torch

    from dashred.core.threads import use_threads
    from dashred.pipeline.check.agreement import agreement_remarks
    from dashred.pipeline.check.context import build_check_context
    from dashred.pipeline.check.memory import ensemble_memory_remarks
    from dashred.pipeline.check.recording_checks.recording import recording_remarks
    from dashred.pipeline.check.simulator_checks.ensemble import ensemble_remarks, structure_remarks
    from dashred.pipeline.check.simulator_checks.observability import (
        linearised_observations,
        observability_remarks,
    )
    from dashred.pipeline.check.simulator_checks.run_time import (
        run_time_remark,
        snapshots_run_time_remark,
    )
    from dashred.pipeline.check.simulator_checks.simulator import run_nominal, simulator_remarks
    from dashred.pipeline.check.snapshots import snapshots_remarks
    from dashred.pipeline.check.splits import splits_remarks

    torch.set_num_threads(1)
    use_threads(config.threads)
    context = build_check_context(config, recorded)
    page.section("Recording", recording_remarks(context))
    page.section("Splits", splits_remarks(context))
    if config.system.snapshots is not None:
        assert context.problem is not None
        page.section("Snapshots", snapshots_remarks(context.problem))
        page.section("Run time", [snapshots_run_time_remark(config)])
        page.conclude()
        return
    nominal = run_nominal(context)
    sources = (simulator_remarks, structure_remarks, ensemble_remarks)
    page.section("Simulator", chain.from_iterable(source(context, nominal) for source in sources))
    observed = linearised_observations(context, nominal)
    page.section("Observability", observability_remarks(context, observed))
    page.section(
        "Agreement of simulator and recording", agreement_remarks(context, nominal, observed)
    )
    page.section("Memory", ensemble_memory_remarks(context))
    page.section("Run time", [run_time_remark(context, nominal, observed)])
    page.conclude()
