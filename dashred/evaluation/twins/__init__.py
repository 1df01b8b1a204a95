"""Twin experiments: record a hidden truth, analyse the recording, score the findings."""
