"""Tests.

A regular package: the wheel of DAPPER installs a package of this name, which would hide a folder.
"""
