"""From the mouse and the keys of the window to commands."""

from typing import Any

import taichi as ti

from taichi_sand.play import files
from taichi_sand.play.commands import Commands
from taichi_sand.play.window.panel import Zone

SCROLL = 40
"""The panel moves by so many pixels a notch."""


class Controls(Commands):
    """What the user does, of one window."""

    def __init__(self, window: Any) -> None:
        super().__init__(window, window.session)
        self.window = window
        self.zone: Zone | None = None  # the slider that is being dragged

    def handle(self, event: Any, x: float, y: float) -> None:
        """One event of the window, the mouse at the pixel (x, y), y down."""
        if event.key in (ti.GUI.LMB, ti.GUI.RMB):
            if event.type == ti.GUI.PRESS:
                self._press(x, y, event.key == ti.GUI.RMB)
            else:
                self._release(x, y)
        elif event.key == ti.GUI.WHEEL:
            self._wheel(x, 1 if event.delta[1] > 0 else -1)
        elif event.key == ti.GUI.EXIT:
            self.quit()
        elif event.type == ti.GUI.PRESS:
            self.key(event.key)

    def tell(self, error: Exception) -> None:
        """As of any face; what a window that is no more cannot tell is raised."""
        if not self.window.gui:
            raise error
        super().tell(error)

    # mouse

    def _press(self, x: float, y: float, other: bool) -> None:
        zone = self.window.screen.panel.under(x, y)
        if zone is not None:
            if zone.knob:
                self.zone = zone
                self.take(zone.knob)
                self._slide(x)
            elif zone.action:
                self.do(*zone.action)
            else:
                self.call(*zone.call)
        elif x < self.window.screen.picture[0]:
            self.press(self.window.screen.place(x, y), other)

    def _release(self, x: float, y: float) -> None:
        if self.zone is not None:
            self._slide(x)
            self.zone = None
        elif self.session.stroke is not None:
            self.release(self.window.screen.place(x, y))

    def held(self, x: float, y: float) -> None:
        """Once a frame: what goes on while a button is held."""
        if self.zone is not None:
            self._slide(x)
        elif self.session.stroke is not None:
            self.drag(self.window.screen.place(x, y))

    def _slide(self, x: float) -> None:
        zone = self.zone
        assert zone and zone.knob
        if all(other.key != zone.knob.key for other in self.session.knobs()):
            self.zone = None  # its effect has been undone under the hand
            return
        self.slide(zone.knob, zone.share(x))

    def _wheel(self, x: float, notches: int) -> None:
        if x >= self.window.screen.picture[0]:
            self.window.screen.panel.scroll(-SCROLL * notches)
            self.window.stale = True
        else:
            self.grow(notches)

    # keys

    def help(self) -> None:
        """Shows the keys, or hides them."""
        self.window.screen.help = not self.window.screen.help
        self.window.stale = True

    def quit(self) -> None:
        """Closes the window."""
        self.window.running = False

    # files

    def picture(self) -> None:
        """Saves what the window shows."""
        self.told = f"saved {files.save_picture(self.window).name}"

    def film(self) -> None:
        """Starts a film, or ends it."""
        if self.window.film is None:
            self.window.film = files.Film(files.free_name(self.window.folder, self.window.name, ".mp4"))
            self.told = "filming"
        else:
            film, self.window.film = self.window.film, None
            self.told = f"saved {film.close().name}"
