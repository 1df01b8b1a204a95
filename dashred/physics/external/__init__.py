"""Programs that are stepped from a state: functions, FMUs and commands."""
