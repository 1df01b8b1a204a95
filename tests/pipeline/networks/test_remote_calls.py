"""Functions that other processes call run in this one, in order."""

from __future__ import annotations

import pytest
import torch

from dashred.pipeline.networks.remote_calls import RemoteCalls, RemoteFunction


def copy_of(function) -> RemoteFunction:
    """Return what another process gets in place of the function."""
    kind, arguments = function.__reduce__()
    return kind(*arguments)


def test_calls_run_in_their_order() -> None:
    calls, told = RemoteCalls(), list[tuple[str, object]]()
    first = calls.accept(lambda value: told.append(("first", value)))
    second = calls.accept(lambda value: told.append(("second", value)))
    with calls.served():
        copy_of(first)({"rmse/x": 0.5})
        copy_of(second)(torch.ones(2))
        copy_of(first)(3)
    assert [name for name, _ in told] == ["first", "second", "first"]
    assert told[0][1] == {"rmse/x": 0.5}
    assert calls.error is None
    first("here")  # as a plain function in this process
    assert told[-1] == ("first", "here")


def test_the_first_error_is_kept_and_the_other_calls_run() -> None:
    calls, told = RemoteCalls(), list[int]()

    def take(number: int) -> None:
        if number < 2:
            raise OSError(f"no space for {number}")
        told.append(number)

    accepted = calls.accept(take)
    with calls.served():
        for number in range(4):
            copy_of(accepted)(number)
    assert told == [2, 3]
    assert str(calls.error) == "no space for 0"


def test_calls_end_with_an_error_of_the_fit() -> None:
    calls = RemoteCalls()
    with pytest.raises(KeyError), calls.served():
        raise KeyError
