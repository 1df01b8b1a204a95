"""A column cannot drive the simulator and be compared with it."""

from __future__ import annotations

import pytest

from dashred.core.errors import InputError
from dashred.data.io.sensor_columns import check_recorded
from dashred.data.io.tables.csv_table import read_table
from dashred.data.sensors import Sensor


def test_a_sensor_in_the_column_of_an_input_is_refused(tmp_path):
    recorded, listed = tmp_path / "soil.csv", tmp_path / "sensors.csv"
    recorded.write_text("time,top,middle\n0,1,2\n1,2,3\n")
    listed.write_text("name,field,x,std\nmiddle,T,0.2,0.1\ntop,T,0,0.1\n")
    sensors = [Sensor("middle", "T", (0.2,)), Sensor("top", "T", (0.0,))]
    tables = read_table(str(recorded)), read_table(str(listed))
    with pytest.raises(InputError, match="'top' is the input T_top") as caught:
        check_recorded(sensors, ["middle"], *tables, {"T_top": "top"})
    assert caught.value.where == str(listed)
