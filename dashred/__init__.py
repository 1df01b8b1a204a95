"""Find the physics that a simulation leaves out, from sparse sensors alone (DA-SHRED)."""
