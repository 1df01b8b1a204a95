"""The command line: one clear message for each mistake, and no analysis before it."""

from __future__ import annotations

from importlib.util import find_spec

import pytest

from dashred.__main__ import main
from dashred.core.errors import InputError
from dashred.evaluation.foreign import optional
from dashred.evaluation.foreign.arguments import read_words


@pytest.mark.parametrize(
    ("words", "message", "hint"),
    [
        ([], "which benchmark", "foreign"),
        (["foregn"], "no benchmark 'foregn'", "did you mean foreign"),
        (["foreign"], "which action", "plan, run, document"),
        (["foreign", "rnu", "draw=x"], "no action 'rnu'", "run"),
        (["foreign", "run"], "tag=NAME and draw=TEXT", "tag=NAME"),
        (["foreign", "run", "draw=x", "tag=y"], "tag=NAME and draw=TEXT", "tag=NAME"),
        (["foreign", "run", "tag=no-such-tag"], "no tag no-such-tag", "git tag"),
        (["foreign", "run", "draw=x", "nois=1"], "unknown key nois", "did you mean noise"),
        (["foreign", "run", "draw=x", "noise=5"], "not a share", "noise=0.02"),
        (["foreign", "run", "draw=x", "collections=field"], "no collection 'field'", "dysts"),
        (["foreign", "run", "draw=x", "limit=0"], "not between 1", "limit="),
    ],
)
def test_a_mistake_is_told_with_what_to_do(words, message: str, hint: str) -> None:
    with pytest.raises(InputError) as caught:
        read_words(words)
    assert message in caught.value.what
    assert hint in f"{caught.value.what} {caught.value.hint}"


def test_a_practice_draw_is_read() -> None:
    request = read_words(["foreign", "plan", "draw=my text", "noise=0.02,0.05", "draws=1"])
    assert request.practice and request.draw == request.name == "my text"
    assert request.noise == (0.02, 0.05) and request.draws == 1
    assert request.output.name == "my_text"


def test_a_missing_package_is_told_with_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    missing = ("dysts", "pde")
    monkeypatch.setattr(
        optional, "find_spec", lambda name: None if name in missing else find_spec(name)
    )
    with pytest.raises(InputError, match="dysts and py-pde are needed") as caught:
        main(["evaluate", "foreign", "plan", "draw=x"])
    assert caught.value.hint and "dashred[evaluation]" in caught.value.hint
    with pytest.raises(InputError, match="dysts is needed"):
        optional.import_optional("dysts.flows")
