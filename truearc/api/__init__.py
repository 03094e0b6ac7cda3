"""The Python API, one module per group of names; users reach all of it as `truearc.NAME`."""
