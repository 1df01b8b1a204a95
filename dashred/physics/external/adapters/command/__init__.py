"""Commands that step states: a process for each call, with files for input and output."""
