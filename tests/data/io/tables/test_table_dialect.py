"""Tables as loggers write them are read as the same numbers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from dashred.core.errors import InputError
from dashred.data.io.tables.csv_table import read_table

COLUMNS = ("time", "u", "v")
VALUES = np.array([[0.0, 1.5, -2e-3], [0.25, 1.25, 1e4], [0.5, -0.125, 7.0]])


def written(separator: str, decimal: str = ".", form: str = "{!r}") -> str:
    lines = [separator.join(COLUMNS)]
    for row in VALUES.tolist():
        lines.append(separator.join(form.format(x).replace(".", decimal) for x in row))
    return "\n".join(lines) + "\n"


TABLES = {
    "commas": written(","),
    "semicolons": written(";"),
    "semicolons and decimal commas": written(";", ","),
    "tabs": written("\t"),
    "tabs and decimal commas": written("\t", ","),
    "a space": written(" "),
    "columns aligned by spaces": "  " + written("    ", form="{:>12}"),
    "spaces around commas": written(" , "),
    "commas between thousands": written(",", form='"{:,}"'),
    "comments": "# logger 7\n#\n\n" + written(","),
    "numpy.savetxt": "# " + written(" "),
    "numpy.savetxt with commas": "# a run\n# " + written(", "),
}


@pytest.mark.parametrize("case", TABLES)
def test_the_table_has_these_numbers(write: Callable[[str, str], str], case: str) -> None:
    table = read_table(write("r.txt", TABLES[case]))
    assert table.columns == COLUMNS
    found = np.stack([table.numbers(column) for column in COLUMNS], axis=1)
    np.testing.assert_array_equal(found, VALUES)


@pytest.mark.parametrize("case", TABLES)
def test_an_error_names_its_line(write: Callable[[str, str], str], case: str) -> None:
    lines = TABLES[case].splitlines()
    lines[-1] = lines[-1].replace("7", "seven")
    table = read_table(write("r.txt", "\n".join(lines)))
    with pytest.raises(InputError, match=r"'seven.*' is not a number") as caught:
        table.numbers("v")
    assert str(caught.value.where).startswith(table.path + f":{len(lines)}, column 'v'")


def test_a_header_with_a_name_of_two_words_is_one_column_with_commas(
    write: Callable[[str, str], str],
) -> None:
    table = read_table(write("r.csv", "time,wind speed [m/s]\n0,1\n"))
    assert table.columns == ("time", "wind speed")
    assert table.units == {"wind speed": "m/s"}


def test_a_quoted_header_may_contain_another_separator(write: Callable[[str, str], str]) -> None:
    table = read_table(write("r.csv", 'time,"flow; left"\n0,1\n'))
    assert table.columns == ("time", "flow; left")
