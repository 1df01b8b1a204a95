"""Integration in time of finite volumes."""
