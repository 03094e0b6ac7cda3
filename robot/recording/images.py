"""The images that a session kept."""

from pathlib import Path

import cv2
import msgspec
import numpy as np

from truearc.hw.readings import CameraFrame
from truearc.robot.recording.session import FRAMES, INDEX, Picture


def load_pictures(session: Path) -> list[Picture]:
    """The index of the images, oldest first; a line that is torn names none."""
    path = session / FRAMES / INDEX
    pictures = []
    for line in path.read_bytes().split(b"\n") if path.exists() else []:
        try:
            pictures.append(msgspec.json.decode(line, type=Picture))
        except msgspec.MsgspecError:
            continue
    return pictures


def load_image(session: Path, picture: Picture) -> CameraFrame | None:
    """One image as it was seen; None when the file is missing or is no image."""
    path = session / FRAMES / picture.file
    data = np.fromfile(path, dtype=np.uint8) if path.is_file() else np.zeros(0, np.uint8)
    image = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
    return None if image is None else CameraFrame(picture.t_ns, np.asarray(image, dtype=np.uint8))
