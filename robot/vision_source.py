"""Where sightings come from: a camera and vision, in this process or in another."""

from collections.abc import Callable
from typing import Protocol

from truearc.hw.protocols import Camera, CameraFrame, LinkLost
from truearc.hw.reason import Reason
from truearc.robot.reasons import VISION_FAILED
from truearc.robot.types import Sighting

LONGEST_DETAIL = 1000                 # characters, of whatever an error has to say


class Eyes(Protocol):
    """Neither call blocks the tick; both raise LinkLost when the camera is gone."""

    def read(self) -> Sighting | None:
        """What vision made of the newest image, once; None when there is nothing new."""

    def picture(self) -> CameraFrame | None:
        """The image behind the newest sighting read."""


class NoEyes:
    """For what needs no target."""

    def read(self) -> Sighting | None:
        return None

    def picture(self) -> CameraFrame | None:
        return None


class InlineEyes:
    """Camera and vision in the caller's own time."""

    def __init__(self, camera: Camera, see: Callable[[CameraFrame], Sighting]) -> None:
        self._camera, self._see = camera, see
        self._picture: CameraFrame | None = None

    def read(self) -> Sighting | None:
        picture = self._camera.read()
        if picture is None:
            return None
        self._picture = picture
        try:
            return self._see(picture)
        except Exception as error:    # whatever vision or its libraries may raise: the loop goes on, and holds
            raise LinkLost(vision_failed(error)) from error

    def picture(self) -> CameraFrame | None:
        return self._picture


def vision_failed(error: Exception) -> Reason:
    """Of an image on which vision failed: it does not even know that there is no target."""
    return VISION_FAILED(detail=f"{type(error).__name__}: {error}"[:LONGEST_DETAIL])
