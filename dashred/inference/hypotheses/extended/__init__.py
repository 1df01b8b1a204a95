"""Terms beyond the library."""
