"""Opens a window, which shows at once how the scene begins: before Taichi is started, and all that takes time to import or compile."""

import os
import sys
import time
from typing import Any

import taichi as ti

from taichi_sand.errors import SandError
from taichi_sand.play.window.shape import Shape
from taichi_sand.play.window.sheet import Type
from taichi_sand.play.window.waiting import Waiting
from taichi_sand.scene.packing import pack
from taichi_sand.scene.schema import Scene
from taichi_sand.view import palette
from taichi_sand.view.still import still

TRIES, PAUSE = 5, 0.3
"""How often a window is tried to be opened, and the time between [s]."""
NO_DISPLAY = "there is no display to open a window on; `taichi-sand play --web` plays in a browser, `taichi-sand render` makes films"


class Opening:
    """A window in the size that suits a scene. Arguments as those of `taichi-sand play`; SandError if there is no display."""

    def __init__(self, scene: Scene, name: str, width: int | None, text: int) -> None:
        self.scene, self.name, self.width, self.text = scene, name, width, text
        self.shape = Shape.of(scene.size, width, text)
        title = f"taichi_sand: {scene.title or name}"
        for left in reversed(range(TRIES)):  # a display server whose last window was closed may be starting afresh
            try:
                self.gui: Any = ti.GUI(title, self.shape.size, fast_gui=True)  # type: ignore[arg-type]
                break
            except RuntimeError:
                if not left:
                    raise SandError(NO_DISPLAY) from None
                time.sleep(PAUSE)
        self.gui.fps_limit = None
        self.waiting = Waiting(self.gui, self.shape, Type.of(text), lambda: True)

    def show(self) -> None:
        """The scene as it is packed, and that something is coming."""
        shape, (wide, high) = self.shape, self.shape.picture
        canvas = self.gui.img.reshape(shape.high, -1)
        canvas[:] = palette.packed(palette.GROUND)
        canvas[:, shape.wide :] = palette.packed(palette.PANEL)
        canvas[shape.top : shape.top + high, shape.left : shape.left + wide] = still(self.scene, pack(self.scene), shape.picture)
        self.waiting.begin(self.scene.title or self.name)
        self.waiting.show()


def check_display() -> None:
    """SandError where X11 is what windows are opened by, and there is none: before anything is compiled."""
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        raise SandError(NO_DISPLAY)
