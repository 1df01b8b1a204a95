"""The cases of the proof: drawing, recording and describing them."""
