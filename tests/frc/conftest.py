"""A real NetworkTables server for all of these tests."""

from tests.frc.nt_server import nt_server  # noqa: F401  # a fixture
