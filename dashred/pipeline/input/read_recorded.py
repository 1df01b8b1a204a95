"""Read the recording of a configuration."""

from __future__ import annotations

from dashred.config import Config
from dashred.core.stated.column_names import parse_columns
from dashred.core.stated.record_part import parse_part
from dashred.data.episodes import Episodes
from dashred.data.io.reader import read_episodes
from dashred.data.io.tables.table_layout import TableLayout
from dashred.physics.system import System


def read_recorded(config: Config, system: System) -> Episodes:
    """Read the recording at ``recording.path``.

    Raises:
        InputError: the recording is invalid.
    """
    assert config.recording.path is not None
    table = config.recording.sensors if isinstance(config.recording.sensors, str) else None
    return read_episodes(config.recording.path, table, system, layout_of_table(config))


def layout_of_table(config: Config) -> TableLayout:
    """Return what the configuration says about the table of the recording.

    Raises:
        InputError: ``recording.columns``, ``begin`` or ``end`` is invalid.
    """
    recording = config.recording
    names, headers = parse_columns(recording.columns, config.where("recording.columns"))
    part = parse_part(recording.begin, recording.end, config.where)
    return TableLayout(names, headers, recording.ignore, recording.every, part=part)
