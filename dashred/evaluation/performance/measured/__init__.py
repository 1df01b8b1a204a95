"""What a process of its own measures: pieces of an analysis, and the rates of the machine."""
