"""How large the display is."""

import ctypes
import os
import sys

USUAL = (1366, 768)
"""The size that is taken where it cannot be asked for [px]: that of many laptops."""
FRAME = (20, 76)
"""What the frame of a window and a task bar take of it."""


def display_size() -> tuple[int, int]:
    """Width and height of the display [px]."""
    if not sys.platform.startswith("linux") or not os.environ.get("DISPLAY"):
        return USUAL
    try:
        x = ctypes.CDLL("libX11.so.6")
        x.XOpenDisplay.restype = ctypes.c_void_p
        x.XOpenDisplay.argtypes = [ctypes.c_char_p]
        display = x.XOpenDisplay(None)
        if not display:
            return USUAL
        for name in ("XDefaultScreen", "XCloseDisplay"):
            getattr(x, name).argtypes = [ctypes.c_void_p]
        for name in ("XDisplayWidth", "XDisplayHeight"):
            getattr(x, name).argtypes = [ctypes.c_void_p, ctypes.c_int]
        screen = x.XDefaultScreen(display)
        size = x.XDisplayWidth(display, screen), x.XDisplayHeight(display, screen)
        x.XCloseDisplay(display)
    except (OSError, AttributeError):
        return USUAL
    return size
