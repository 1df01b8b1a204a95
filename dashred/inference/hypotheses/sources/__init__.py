"""A localised source: a bump in space times a course in time, in one equation."""
