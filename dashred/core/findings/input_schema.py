"""The schema of what determines the findings: configuration, recording, splits and versions."""

from typing import Any, NotRequired, TypedDict


class EpisodeSplit(TypedDict):
    """An episode from `begin` to `end` on its own clock; it was fitted until `time_end`.

    If the episode is held out, only its initial state was fitted.
    """

    name: str
    begin: float
    end: float
    time_end: float
    held_out_whole: bool


class Splits(TypedDict):
    """Names of the sensors in each role, the end of the fit window, and a note about the window.

    `episodes` exists only with several episodes; the window is then that of the longest one.
    """

    inputs: list[str]
    extra: list[str]
    validate: list[str]
    test: list[str]
    time_end: float
    note: str | None
    episodes: NotRequired[list[EpisodeSplit]]


class Input(TypedDict):
    """Everything that determines the findings.

    `snapshots_sha256` exists only with snapshots. `library_left_out` has the default terms,
    `equation: term`, that data like the simulation cannot determine, and the reason.
    """

    config: dict[str, Any]
    config_sha256: str
    recording_sha256: str
    snapshots_sha256: NotRequired[str]
    seed: int
    versions: dict[str, str]
    library_size: dict[str, int] | None
    library_left_out: NotRequired[dict[str, str]]
    splits: Splits | None
