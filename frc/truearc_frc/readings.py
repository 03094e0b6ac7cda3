"""The ReadingTable for [nt4] in launcher.toml: the camera, the velocity, the hood angle and the published advice."""

from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path

from truearc.hw.devices.family import Finding
from truearc.hw.protocols import Clock
from truearc.robot.config.named_tables import ReadingTable
from truearc.robot.config.schema import Config
from truearc.robot.eyes import Layer, OwnEyes, Source
from truearc.robot.runtime import Screen
from truearc_frc.advice import NtPublisher
from truearc_frc.doctor import look_at_server
from truearc_frc.inputs import NT_ENCODER, OwnNtCamera, open_moving
from truearc_frc.keys import NtKeys
from truearc_frc.table import NAME, Nt4, nt4_errors, nt4_of


class NtSource(Source):
    """Everything that `truearc run` reads from the robot's NetworkTables server and publishes there."""

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        nt4 = nt4_of(config)
        assert nt4 is not None
        self._nt4 = nt4

    def open_eyes(self, clock: Clock) -> OwnEyes | None:
        return None if self._nt4.vision is None else OwnNtCamera(self.config, clock)

    def open_layer(self, wires: ExitStack, is_apart: bool) -> Layer | None:
        return None if self._nt4.velocity is None else open_moving(self.config, wires, is_apart)

    def open_screen(self, gate_path: Path | None, clock: Clock | None) -> Screen:
        return NtPublisher(self.config, NtKeys(self._nt4.server, ()), gate_path, clock)

    def findings(self) -> Iterable[Finding]:
        return look_at_server(self.config)


NT4 = ReadingTable(name=NAME, table=Nt4, source=NtSource, errors=nt4_errors, encoder=lambda: NT_ENCODER)
