"""What there is to run: ``python -m dashred``."""

from __future__ import annotations

import sys

from dashred.core.errors import DONE, WRONG_INPUT

COMMANDS = """\
usage: python -m dashred.COMMAND [key=value ...]; each has --help

for a recording of your own
  init       write a first configuration for a CSV
  check      say within seconds what is wrong or doubtful before a run
  train      find what a simulation leaves out; resume=RUN_ID goes on with a run
  fetch      fetch the recording of a real pendulum
  reference  print every configuration key, with its meaning and default

for the evidence
  bench      twin experiments by system, twin, noise, sensors and seed
  compare    the same, beside other methods
  prove      concealed cases, whose truth is on no disk while they are analysed
"""


def main() -> int:
    """Print the commands."""
    print(COMMANDS, end="")
    return DONE if {"--help", "-h"} & set(sys.argv) else WRONG_INPUT


if __name__ == "__main__":
    sys.exit(main())
