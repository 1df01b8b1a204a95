"""Lines of CSV and objects of JSON become messages; what is not one is left out with a remark."""

from __future__ import annotations

import math

import pytest

from dashred.core.errors import InputError
from dashred.pipeline.follow.remarks import Remarks
from dashred.pipeline.follow.sources.messages import LineReader, number, parse_json


@pytest.fixture
def said() -> list[str]:
    return []


@pytest.fixture
def lines(said: list[str]) -> LineReader:
    return LineReader("here", Remarks(said.append))


@pytest.mark.parametrize("sign", [",", ";", "\t"])
def test_a_csv_is_read_in_any_pieces(sign: str, lines: LineReader) -> None:
    text = sign.join(["time", "a", "b"]) + "\n" + sign.join(["0.5", "1e-3", ""]) + "\n"
    found = [message for letter in text for message in lines.feed(letter)]
    assert len(found) == 1 and found[0].time == 0.5
    assert found[0].readings["a"] == 1e-3 and math.isnan(found[0].readings["b"])


def test_the_last_line_needs_no_end(lines: LineReader) -> None:
    assert not lines.feed("time,a\n1,2")
    [message] = lines.finish()
    assert message == (1.0, {"a": 2.0}) and not lines.finish()


def test_lines_of_json_are_read(lines: LineReader) -> None:
    [message] = lines.feed('{"time": 1.5, "a": 2, "b": null}\n')
    assert message.time == 1.5 and message.readings["a"] == 2
    assert math.isnan(message.readings["b"])


def test_a_header_without_time_is_refused(lines: LineReader) -> None:
    with pytest.raises(InputError, match="no column 'time'"):
        lines.feed("a,b\n")


def test_broken_lines_are_left_out_with_one_remark_each(lines: LineReader, said: list[str]) -> None:
    found = lines.feed("time,a\n1\n2\n3,4\nx,5\nnan,6\n{broken\n[]\n")
    assert [message.time for message in found] == [3.0]
    assert len(said) == 3


@pytest.mark.parametrize("text", ["", "null", "[1]", "{", '{"a": 1}', '{"time": "soon"}', b"\xff"])
def test_what_is_no_message_is_left_out(text: str | bytes, said: list[str]) -> None:
    assert parse_json(text, "here", Remarks(said.append)) is None
    assert len(said) == 1


@pytest.mark.parametrize("value", [True, None, "x", [], {}, "inf", math.inf, 10**400, "nan"])
def test_what_is_no_number_is_missing(value: object) -> None:
    assert math.isnan(number(value))
