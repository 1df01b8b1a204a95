"""Results of programs that are kept on disk, and the contents by which they are found."""
