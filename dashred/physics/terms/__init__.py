"""Terms of the library, of lets, and their units."""
