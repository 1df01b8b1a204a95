"""Analysis with snapshots in place of a simulator."""
