"""The Python API, one module per group of names. All names are available as `truearc.NAME`."""
